"""exam.html: one self-contained page."""

from collections.abc import Mapping, Sequence
from math import isfinite
from typing import Any

import numpy as np

from rfca_rig import __version__
from rfca_rig.exam import cases
from rfca_rig.exam.bars import ScoreGoal, bars
from rfca_rig.exam.outcome import DETECTABLE, OUTCOMES
from rfca_rig.exam.score import POWER_AT, ExamScores, Share
from rfca_rig.exam.scored import ExamResult, ScoredCase
from rfca_rig.exam.worst_cases import LISTED
from rfca_rig.report import exam_pictures
from rfca_rig.report.exam_matrix import matrix_of
from rfca_rig.report.exam_tables import ablation_table, follow_up_table
from rfca_rig.report.provenance import Origin, command_line
from rfca_rig.report.templates import template
from rfca_rig.report.text import NO_BREAK, NOTHING, count_noun, number

MEANINGS = {
    "right": "names exactly what is there; or nothing where nothing is; or says that it cannot explain what no name fits",
    "class": "what is there is among those that a name is said to be indistinguishable from",
    "partial": "some of what is there, nothing false",
    "extra": "all that is there, and something false",
    "wrong": "something false, and not all that is there",
    "silent": "“nothing missing”, though something is",
    "cautious": "no name where one was to be had, or an alarm where nothing is missing",
}
PASSED = {True: "passed", False: "failed", None: "none"}


def page(exam: ExamResult, files: Sequence[str] = (), version: str = __version__) -> str:
    """The page as HTML.

    Parameters
    ----------
    exam
        The scored exam.
    files
        Names of the files beside the page, which it links.
    version
        Version of the program, for the foot of the page.
    """
    marks, all_bars = exam.marks, bars(exam.marks)
    judged = [bar for bar in all_bars if bar.passed is not None]
    return template("exam.html").render(
        sheets=("verdict.css", "exam.css"),
        origin=Origin(_command_line(exam), (), version, "of the same cases"),
        files=files,
        of=f"Blind exam of the diagnosis: {exam.words}, rfca-rig {__version__}",
        sentence=_sentence(marks, len(exam.cases)),
        passed=sum(bar.passed is True for bar in judged),
        judged=len(judged),
        bars=[_bar(bar) for bar in all_bars],
        detectable=f"{DETECTABLE:g}",
        ways=follow_up_table(exam.ways),
        taken_out=ablation_table(exam.taken_out) if exam.taken_out else None,
        outcomes=_outcomes(marks),
        meanings=MEANINGS,
        matrix=matrix_of(exam.cases),
        pictures=_pictures(exam),
        shades=[(colour, words) for _, colour, words in exam_pictures.PARTS],
        calibration=_calibration(marks),
        values=_values(marks),
        gap=_gap(marks),
        power=_power(marks),
        detection=_detection(marks),
        worst=[{"case": miss.case, "kind": miss.kind, "reason": miss.reason} for miss in marks.worst],
        listed=LISTED,
        time=_time(exam.cases),
    )


def share_text(value: float, trimmed: bool = True) -> str:
    """A share in percent, as in "2.5 %"; a trailing ".0" is removed where `trimmed`."""
    if not isfinite(value):
        return NOTHING
    text = number(100.0 * value, 1)
    return f"{text.removesuffix('.0') if trimmed else text}{NO_BREAK}%"


def _sentence(marks: ExamScores, count: int) -> str:
    """Standfirst: number of cases, and of false names, which are the worst answers."""
    names, null = marks.false_discoveries, marks.null_false_claims
    text = f"{count_noun(count, 'campaign')} of another simulator, truths under seal: "
    were = "was" if names.of == 1 else "were"
    text += f"{names.hits} of {count_noun(names.of, 'name')} {were} false" if names.of else "nothing was named"
    return f"{text}; {null.hits or 'none'} of {null.of} campaigns that lack nothing were given a name." if null.of else f"{text}."


def _bar(bar: ScoreGoal) -> dict[str, str]:
    limits = [("at least", bar.at_least), ("at most", bar.at_most)]
    # A limit above 1 is no share, but a mean number, and is not shown in percent.
    plain = any(limit is not None and limit > 1.0 for _, limit in limits)
    text = _plain if plain else share_text
    worse = "above" if bar.at_least is not None else "below"
    return {
        "name": bar.name,
        "goal": " and ".join(f"{word} {text(limit)}" for word, limit in limits if limit is not None),
        "value": _plain(bar.value) if plain else share_text(bar.value, trimmed=False),
        "counted": bar.counted,
        "bound": f"{worse} {text(bar.bound)}" if bar.bound is not None else "",
        "passed": PASSED[bar.passed],
    }


def _plain(value: float) -> str:
    return number(value, 1) if isfinite(value) else NOTHING


def _outcomes(marks: ExamScores) -> dict[str, Any]:
    lines = [(kind, sum(counts.values()), [counts.get(word, 0) for word in OUTCOMES]) for kind, counts in marks.outcomes.items()]
    return {"words": OUTCOMES, "lines": lines, "totals": [sum(counts[place] for _, _, counts in lines) for place in range(len(OUTCOMES))]}


def _pictures(exam: ExamResult) -> Mapping[str, str]:
    single = any(case.kind == cases.SINGLE for case in exam.cases)
    return {
        "reliability": exam_pictures.draw_reliability(exam.marks.calibration) if exam.marks.calibration.bins else "",
        "power": exam_pictures.draw_power(exam.cases) if single else "",
        "errors": exam_pictures.draw_parameter_errors(exam.cases) if exam.marks.values.count else "",
        "gaps": exam_pictures.draw_gaps(exam.cases) if exam.marks.gap_worse.of else "",
    }


def _power(marks: ExamScores) -> str:
    """Detection rate by size of the effect, as in "below 0.5: 0 of 3; from 0.5: 1 of 2"."""
    limits = (f"below {POWER_AT[0]:g}", *(f"from {at:g}" for at in POWER_AT))
    return "; ".join(f"{limit}: {share.hits} of {share.of}" for limit, share in zip(limits, marks.power, strict=True) if share.of)


def _calibration(marks: ExamScores) -> str:
    found = marks.calibration
    return (
        f"Calibration error {share_text(found.ece)}, Brier score {number(found.brier, 3)}, logarithmic score {number(found.log_score, 3)}."
    )


def _values(marks: ExamScores) -> str:
    found = marks.values
    covered = f"; {share_text(found.coverage_90)} of the 90 % intervals hold the truth" if isfinite(found.coverage_90) else ""
    return f"{count_noun(found.count, 'parameter')}: half of them within {share_text(found.median_error)}{covered}."


def _gap(marks: ExamScores) -> str:
    got = marks.gap_worse
    return f"Median {share_text(marks.gap_closed)} over {count_noun(got.of, 'case')} with right names; {got.hits or 'none'} got worse."


def _detection(marks: ExamScores) -> str:
    alarms, missed, errors = (_of(share) for share in (marks.false_alarms, marks.missed, marks.detection_errors))
    return (
        f"As the DXC competitions count: {alarms} false alarms where nothing is missing; {missed} missed of what can be seen; "
        f"{errors} cases with the wrong answer to whether anything is missing; {marks.classification_errors} names false or missing."
    )


def _of(share: Share) -> str:
    return f"{share.hits} of {share.of}"


def _time(marked: Sequence[ScoredCase]) -> str:
    seconds = [case.seconds for case in marked if case.seconds is not None]
    if not seconds:
        return ""
    median, longest, total = np.median(seconds), max(seconds), sum(seconds)
    each = f"A diagnosis took {median:.0f} s of one core (median), {longest:.0f} s at most"
    return f"{each}; all {len(seconds)} together {total / 3600.0:.1f} h."


def _command_line(exam: ExamResult) -> str:
    """Command line that writes and scores the same cases again."""
    numbers = {kind: number for kind, number in exam.plan.numbers.items() if number}
    only = next(iter(numbers)) if len(numbers) == 1 else None
    options = {"--out": "exam", "--seed": exam.plan.seed, "--cases": sum(numbers.values()), "--kind": only}
    return command_line("prove", options={**options, "--follow-up": bool(exam.ways), "--take-out-each": exam.taken_out is not None})
