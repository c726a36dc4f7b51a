"""Writes the files of an exam (the blind benchmark of the diagnosis).

exam.html is for people: one self-contained page, with figures of calibration, power, errors of
parameters and misfit removed. exam.json is for programs, exam.csv has a line for each case, and
tables as CSV and LaTeX are for papers.
"""

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, fields, replace
from math import isfinite
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from rfca_rig import __version__
from rfca_rig.escaping import html_text
from rfca_rig.exam import cases
from rfca_rig.exam.answer import CLASS, DETECTABLE, EXTRA, OUTCOMES, RIGHT, WRONG
from rfca_rig.exam.claims import ClaimCalibration
from rfca_rig.exam.score import LISTED, POWER_AT, ExamScores, Share
from rfca_rig.exam.scored import ExamResult, ParameterDeviation, ScoredCase
from rfca_rig.exam.scoring import ScoreGoal, bars
from rfca_rig.reports.diagnosis.json_file import to_json_types
from rfca_rig.reports.exam.tables import (
    ARM_WORDS,
    KIND_WORDS,
    OUTCOME_WORDS,
    VERDICT_WORDS,
    ablation_table,
    bars_table,
    confusion_table,
    follow_up_table,
    matrix_of,
)
from rfca_rig.reports.provenance import Origin, command_line, version_text
from rfca_rig.reports.style import ALIKE, BAD, FAINT, MEASURED, PALE, SMALL, drawing, inline_svg
from rfca_rig.reports.table import Table, TableColumn, TableRow, table_files, write_all
from rfca_rig.reports.table import as_csv as table_as_csv
from rfca_rig.reports.templates import template
from rfca_rig.reports.text import NO_BREAK, NOTHING, count_noun, number

MEANINGS = {
    "right": (
        "exactly the hidden effects; nothing where nothing is hidden; unexplained where the "
        "effect is outside the catalogue"
    ),
    "class": "the hidden effect is in the indistinguishable set of the identified one",
    "partial": "some of the hidden effects, none wrong",
    "extra": "all hidden effects, and a wrong one",
    "wrong": "a wrong effect, and not all hidden ones",
    "silent": "nothing missing, though an effect is hidden",
    "cautious": "no effect where one could be identified, or an alarm where nothing is hidden",
}
PASSED = {True: "passed", False: "failed", None: "none"}

WIDTH_IN = 4.3
HEIGHT_IN = 3.1
# Height of the line of one effect in the figure of parameters.
LINE_IN = 0.17
# Relative errors beyond these are drawn at the border.
SMALLEST = 1e-3
LARGEST = 10.0
# Kinds of cases whose parameters and fitted models are scored.
SCORED_KINDS = (cases.SINGLE, cases.PAIR)
# Parts of a stacked bar from below: outcomes, colour, words. The part without outcomes takes all
# that no other part lists.
PARTS = (
    ((RIGHT,), MEASURED, "right"),
    ((CLASS,), ALIKE, "in its indistinguishable set"),
    ((), PALE, "none identified"),
    ((WRONG, EXTRA), BAD, "wrong effect"),
)


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
    marks = exam.marks
    all_bars = bars(exam.marks)
    judged = [bar for bar in all_bars if bar.passed is not None]
    return template("exam.html").render(
        sheets=("verdict.css", "exam.css"),
        origin=Origin(_command_line(exam), (), version, "of the same cases"),
        files=files,
        of=f"Blind benchmark of the diagnosis: {exam.words}, rfca-rig {__version__}",
        sentence=_sentence(marks, len(exam.cases)),
        passed=sum(bar.passed is True for bar in judged),
        judged=len(judged),
        bars=[_bar(bar) for bar in all_bars],
        detectable=f"{DETECTABLE:g}",
        ways=follow_up_table(
            [replace(way, arm=ARM_WORDS.get(way.arm, way.arm)) for way in exam.ways]
        ),
        taken_out=ablation_table(exam.taken_out) if exam.taken_out else None,
        outcomes=_outcomes(marks),
        meanings={OUTCOME_WORDS.get(word, word): meaning for word, meaning in MEANINGS.items()},
        kind_words=KIND_WORDS,
        verdict_words=VERDICT_WORDS,
        matrix=matrix_of(exam.cases),
        pictures=_pictures(exam),
        shades=[(colour, words) for _, colour, words in PARTS],
        calibration=_calibration(marks),
        values=_values(marks),
        gap=_gap(marks),
        power=_power(marks),
        detection=_detection(marks),
        worst=[
            {"case": miss.case, "kind": KIND_WORDS.get(miss.kind, miss.kind), "reason": miss.reason}
            for miss in marks.worst
        ],
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
    """Headline: number of cases, and of wrong effects, which are the worst answers."""
    names = marks.false_discoveries
    null = marks.null_false_claims
    text = f"{count_noun(count, 'campaign')} of another simulator with hidden effects: "
    were = "was" if names.of == 1 else "were"
    text += (
        f"{names.hits} of {count_noun(names.of, 'identified effect')} {were} wrong"
        if names.of
        else "no effect was identified"
    )
    if null.of:
        return (
            f"{text}; in {null.hits or 'none'} of {null.of} campaigns without one, an effect "
            "was identified."
        )
    return f"{text}."


def _bar(bar: ScoreGoal) -> dict[str, str]:
    limits = [("at least", bar.at_least), ("at most", bar.at_most)]
    # A limit above 1 is no share, but a mean number, and is not shown in percent.
    plain = any(limit is not None and limit > 1.0 for _, limit in limits)
    text = _plain if plain else share_text
    worse = "above" if bar.at_least is not None else "below"
    return {
        "name": bar.name,
        "goal": " and ".join(
            f"{word} {text(limit)}" for word, limit in limits if limit is not None
        ),
        "value": _plain(bar.value) if plain else share_text(bar.value, trimmed=False),
        "counted": bar.counted,
        "bound": f"{worse} {text(bar.bound)}" if bar.bound is not None else "",
        "passed": PASSED[bar.passed],
    }


def _plain(value: float) -> str:
    if isfinite(value):
        return number(value, 1)
    return NOTHING


def _outcomes(marks: ExamScores) -> dict[str, Any]:
    lines = [
        (
            KIND_WORDS.get(kind, kind),
            sum(counts.values()),
            [counts.get(word, 0) for word in OUTCOMES],
        )
        for kind, counts in marks.outcomes.items()
    ]
    words = [OUTCOME_WORDS.get(word, word) for word in OUTCOMES]
    return {
        "words": words,
        "lines": lines,
        "totals": [
            sum(counts[column] for _, _, counts in lines) for column in range(len(OUTCOMES))
        ],
    }


def _pictures(exam: ExamResult) -> Mapping[str, str]:
    single = any(case.kind == cases.SINGLE for case in exam.cases)
    return {
        "reliability": draw_reliability(exam.marks.calibration)
        if exam.marks.calibration.bins
        else "",
        "power": draw_power(exam.cases) if single else "",
        "errors": draw_parameter_errors(exam.cases) if exam.marks.values.count else "",
        "gaps": draw_gaps(exam.cases) if exam.marks.gap_worse.of else "",
    }


def _power(marks: ExamScores) -> str:
    """Detection rate by size of the effect, as in "below 0.5: 0 of 3; from 0.5: 1 of 2"."""
    limits = (f"below {POWER_AT[0]:g}", *(f"from {at:g}" for at in POWER_AT))
    return "; ".join(
        f"{limit}: {share.hits} of {share.of}"
        for limit, share in zip(limits, marks.power, strict=True)
        if share.of
    )


def _calibration(marks: ExamScores) -> str:
    scores = marks.calibration
    return (
        f"Calibration error {share_text(scores.ece)}, Brier score {number(scores.brier, 3)}, "
        f"logarithmic score {number(scores.log_score, 3)}."
    )


def _values(marks: ExamScores) -> str:
    accuracy = marks.values
    if isfinite(accuracy.coverage_90):
        covered = (
            f"; {share_text(accuracy.coverage_90)} of the 90 % intervals contain the true value"
        )
    else:
        covered = ""
    return (
        f"{count_noun(accuracy.count, 'parameter')}: median error "
        f"{share_text(accuracy.median_error)}{covered}."
    )


def _gap(marks: ExamScores) -> str:
    got = marks.gap_worse
    return (
        f"Median {share_text(marks.gap_closed)} over {count_noun(got.of, 'case')} with right "
        f"answers; {got.hits or 'none'} became worse."
    )


def _detection(marks: ExamScores) -> str:
    alarms, missed, errors = (
        _of(share) for share in (marks.false_alarms, marks.missed, marks.detection_errors)
    )
    return (
        f"Counted as in the DXC diagnosis competitions: {alarms} false alarms where "
        f"nothing is missing; {missed} missed of the detectable; "
        f"{errors} cases with the wrong answer to whether anything is missing; "
        f"{marks.classification_errors} effects wrong or missing."
    )


def _of(share: Share) -> str:
    return f"{share.hits} of {share.of}"


def _time(marked: Sequence[ScoredCase]) -> str:
    seconds = [case.seconds for case in marked if case.seconds is not None]
    if not seconds:
        return ""
    median = np.median(seconds)
    longest = max(seconds)
    total = sum(seconds)
    clause = f"A diagnosis took {median:.0f} s of one core (median), {longest:.0f} s at most"
    return f"{clause}; all {len(seconds)} together {total / 3600.0:.1f} h."


def _command_line(exam: ExamResult) -> str:
    """Command line that writes and scores the same cases again."""
    numbers = {kind: number for kind, number in exam.plan.numbers.items() if number}
    only = next(iter(numbers)) if len(numbers) == 1 else None
    options = {
        "--out": "exam",
        "--seed": exam.plan.seed,
        "--cases": sum(numbers.values()),
        "--kind": only,
    }
    return command_line(
        "prove",
        options={
            **options,
            "--follow-up": bool(exam.ways),
            "--take-out-each": exam.taken_out is not None,
        },
    )


def draw_reliability(found: ClaimCalibration) -> str:
    """Reliability diagram: share of right claims over the stated probability, with 90 % bounds;
    numbers of claims above.
    """
    return _draw_figure(
        lambda axes: _reliability(axes, found),
        HEIGHT_IN,
        "share of claims that are right against the stated probability",
    )


def draw_power(marked: Sequence[ScoredCase]) -> str:
    """Shares of outcomes for single effects over their strength, in bins of equal width."""
    single = [case for case in marked if case.kind == cases.SINGLE]
    return _draw_figure(
        lambda axes: _draw_power_axes(axes, single),
        HEIGHT_IN,
        "outcomes of cases with one effect, by its strength",
    )


def draw_parameter_errors(marked: Sequence[ScoredCase]) -> str:
    """Relative error of each parameter of a right answer, by effect; hollow where the truth is
    outside the 90 % interval.
    """
    deviations = [
        deviation for case in marked if case.kind in SCORED_KINDS for deviation in case.deviations
    ]
    effects = sorted({deviation.effect for deviation in deviations}, reverse=True)
    height_in = max(HEIGHT_IN, 0.75 + LINE_IN * len(effects))
    return _draw_figure(
        lambda axes: _errors(axes, deviations, effects),
        height_in,
        "relative errors of parameters by effect",
        left_in=1.75,
    )


def draw_gaps(marked: Sequence[ScoredCase]) -> str:
    """Histogram of the share of the misfit on held-out conditions that right answers remove;
    cases that got worse are left of 0.
    """
    right = [case for case in marked if case.kind in SCORED_KINDS and case.outcome == RIGHT]
    closed = [case.gap_closed for case in right if case.gap_closed is not None]
    return _draw_figure(
        lambda axes: _gaps(axes, closed),
        HEIGHT_IN,
        "share of the misfit that right answers remove on held-out conditions",
    )


def _draw_figure(
    draw: Callable[[Axes], None], height_in: float, label: str, left_in: float = 0.6
) -> str:
    with drawing():
        figure = Figure(figsize=(WIDTH_IN, height_in))
        box = (
            left_in / WIDTH_IN,
            0.5 / height_in,
            (WIDTH_IN - left_in - 0.22) / WIDTH_IN,
            (height_in - 0.8) / height_in,
        )
        draw(figure.add_axes(box))
        return inline_svg(figure, label, html_text(label))


def _reliability(axes: Axes, scores: ClaimCalibration) -> None:
    axes.plot([0.0, 1.0], [0.0, 1.0], color=FAINT, lw=0.7, ls=(0, (3, 2)), zorder=0)
    for count, mean, right in scores.bins:
        if count:
            # Two one-sided bounds of 95 % (Clopper and Pearson) make an interval of 90 %.
            share = Share(round(count * right), count)
            axes.plot([mean, mean], [share.lower, share.upper], color=MEASURED, lw=1.1)
            axes.plot(
                [mean], [right], ls="", marker="o", ms=5.5, mfc=MEASURED, mec="white", mew=0.8
            )
            axes.text(
                mean, 1.04, str(count), ha="center", va="bottom", fontsize=SMALL, color="#555555"
            )
    _unit_axes(axes)
    axes.set_xlabel("stated probability")
    axes.set_ylabel("share right")


def _draw_power_axes(axes: Axes, single: Sequence[ScoredCase]) -> None:
    # A strength of exactly 1 belongs to the last bin.
    level = np.array(
        [min(int(case.strength * cases.LEVELS), cases.LEVELS - 1) for case in single], dtype=int
    )
    total = np.bincount(level, minlength=cases.LEVELS)
    centres = (np.arange(cases.LEVELS) + 0.5) / cases.LEVELS
    below = np.zeros(cases.LEVELS)
    listed = {outcome for outcomes, _, _ in PARTS for outcome in outcomes}
    for outcomes, colour, words in PARTS:
        inside = np.array(
            [
                case.outcome in outcomes if outcomes else case.outcome not in listed
                for case in single
            ],
            dtype=bool,
        )
        share = np.bincount(level[inside], minlength=cases.LEVELS) / np.maximum(total, 1)
        axes.bar(centres, share, 0.86 / cases.LEVELS, bottom=below, color=colour, label=words)
        below = below + share
    for x, count in zip(centres, total, strict=True):
        axes.text(x, 1.02, str(count), ha="center", va="bottom", fontsize=SMALL, color="#555555")
    _unit_axes(axes)
    axes.set_xlabel("strength, from hardly visible (0) to gross (1)")
    axes.set_ylabel("share of cases")


def _unit_axes(axes: Axes) -> None:
    axes.set_xlim(0.0, 1.0)
    axes.set_ylim(0.0, 1.0)
    # Markers on the border of the unit square are not cut in half.
    for spread in (axes.lines, axes.collections):
        for artist in spread:
            artist.set_clip_on(False)


def _errors(axes: Axes, deviations: Sequence[ParameterDeviation], effects: Sequence[str]) -> None:
    for covered, face, edge in (
        (True, MEASURED, MEASURED),
        (None, FAINT, FAINT),
        (False, "none", BAD),
    ):
        some = [deviation for deviation in deviations if deviation.covered is covered]
        x = np.clip([deviation.error for deviation in some], SMALLEST, LARGEST)
        axes.plot(
            x,
            [effects.index(deviation.effect) for deviation in some],
            ls="",
            marker="o",
            ms=4.2,
            mfc=face,
            mec=edge,
            mew=0.9,
            alpha=0.85,
        )
    axes.set_xscale("log")
    axes.set_xlim(0.8 * SMALLEST, 1.25 * LARGEST)
    # The goal for the median error of parameters in the exam.
    axes.axvline(0.1, color=FAINT, lw=0.7, ls=(0, (3, 2)), zorder=0)
    axes.set_xticks([0.001, 0.01, 0.1, 1.0, 10.0], ["0.1 %", "1 %", "10 %", "100 %", "1000 %"])
    axes.minorticks_off()
    axes.set_ylim(-0.7, max(len(effects), 1) - 0.3)
    axes.set_yticks(
        range(len(effects)), [effect.replace("_", " ") for effect in effects], fontsize=SMALL
    )
    axes.set_xlabel("error relative to what the effect changes")


def _gaps(axes: Axes, closed: Sequence[float]) -> None:
    edges = np.linspace(-0.2, 1.1, 14)
    # Values beyond the axis count in the outermost bins.
    axes.hist(
        np.clip(closed, edges[0] + 1e-9, edges[-1] - 1e-9),
        edges.tolist(),
        color=ALIKE,
        edgecolor="white",
        linewidth=0.8,
    )
    if closed:
        axes.axvline(float(np.median(closed)), color=MEASURED, lw=1.4)
    # The goal for the median share in the exam.
    axes.axvline(0.8, color=FAINT, lw=0.7, ls=(0, (3, 2)))
    axes.set_xlim(edges[0], edges[-1])
    axes.set_xlabel("share of the misfit removed (1: down to the noise)")
    axes.set_ylabel("right answers")
    axes.yaxis.set_major_locator(MaxNLocator(integer=True))


FORMAT = "rfca-exam/1"
HEADER = (
    "case",
    "kind",
    "truth",
    "verdict",
    "named",
    "probability",
    "outcome",
    "seconds",
    "strength",
    "left_over_noise",
)


def write_exam(exam: ExamResult, out: Path) -> None:
    """Writes all files into the existing folder `out`. Raises RigError where a file cannot be
    written.
    """
    taken_out = (ablation_table(exam.taken_out),) if exam.taken_out else ()
    tables = (
        bars_table(bars(exam.marks)),
        follow_up_table(exam.ways),
        *taken_out,
        confusion_table(exam.cases),
    )
    contents = {"exam.json": as_json(exam), "exam.csv": as_csv(exam), **table_files(tables)}
    write_all(out, {"exam.html": page(exam, tuple(contents), version_text()), **contents})


def as_csv(exam: ExamResult) -> str:
    """A line for each case. Several effects are joined by +; the probability is that of the
    least certain name.
    """
    rows = tuple(TableRow(dict(zip(HEADER, _line(case), strict=True))) for case in exam.cases)
    return table_as_csv(Table("exam", "", tuple(TableColumn(name) for name in HEADER), rows))


def _line(case: ScoredCase) -> list[str]:
    if case.probabilities:
        probability = f"{min(case.probabilities):.4f}"
    else:
        probability = ""
    seconds = "" if case.seconds is None else f"{case.seconds:.1f}"
    answer = [case.verdict, "+".join(case.named), probability, case.outcome, seconds]
    return [
        case.id,
        case.kind,
        "+".join(case.concealed),
        *answer,
        f"{case.strength:.3f}",
        f"{case.left:.3g}",
    ]


def as_json(exam: ExamResult) -> str:
    """The JSON document: required scores (bars), all scores (marks), and every case; unknown
    values are null.
    """
    scores = {
        field.name: _plain_score(getattr(exam.marks, field.name)) for field in fields(exam.marks)
    }
    confused = [
        {"truth": true, "named": called, "count": count}
        for (true, called), count in sorted(exam.marks.confusion.items())
    ]
    document = {
        "format": FORMAT,
        "version": __version__,
        "seed": exam.plan.seed,
        "numbers": exam.plan.numbers,
        "bars": [asdict(bar) | {"passed": bar.passed} for bar in bars(exam.marks)],
        "marks": scores | {"confusion": confused},
        "follow_ups": [asdict(way) for way in exam.ways],
        "taken_out": {
            field.name: _plain_score(getattr(exam.taken_out, field.name))
            for field in fields(exam.taken_out)
        }
        if exam.taken_out
        else None,
        "cases": [asdict(case) for case in exam.cases],
    }
    return json.dumps(to_json_types(document), indent=1, ensure_ascii=False, allow_nan=False) + "\n"


def _plain_score(value: object) -> object:
    """A share with its confidence bounds; other values unchanged."""
    if isinstance(value, Share):
        return {
            "hits": value.hits,
            "of": value.of,
            "value": value.value,
            "lower": value.lower,
            "upper": value.upper,
        }
    if isinstance(value, tuple):
        return [_plain_score(item) for item in value]
    return asdict(value) if hasattr(value, "__dataclass_fields__") else value  # type: ignore[call-overload]
