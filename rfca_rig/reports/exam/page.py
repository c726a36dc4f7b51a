"""Writes the files of an exam (the blind benchmark of the diagnosis).

exam.html is for people: one self-contained page, as a list of its sections. exam.json is for
programs, exam.csv has a line for each case, and tables as CSV and LaTeX are for papers.
"""

import json
from collections.abc import Callable, Sequence
from dataclasses import asdict, fields, replace
from math import isfinite
from pathlib import Path
from typing import Any

import numpy as np
from markupsafe import Markup

from rfca_rig import __version__
from rfca_rig.exam import cases
from rfca_rig.exam.answer import DETECTABLE, OUTCOMES
from rfca_rig.exam.score import MAX_LISTED, POWER_AT, ExamScores, Share
from rfca_rig.exam.scored import ExamResult, ScoredCase
from rfca_rig.exam.scoring import ScoreGoal, bars
from rfca_rig.reports.diagnosis.json_file import to_json_types
from rfca_rig.reports.elements import (
    aside,
    bare_figure,
    code,
    css_class,
    html,
    join,
    legend,
    legend_box,
    link,
    mark,
    pairs,
    paragraph,
    verdict,
)
from rfca_rig.reports.exam.pictures import (
    PARTS,
    draw_gaps,
    draw_parameter_errors,
    draw_power,
    draw_reliability,
)
from rfca_rig.reports.exam.tables import (
    ARM_WORDS,
    KIND_WORDS,
    OUTCOME_WORDS,
    VERDICT_WORDS,
    Matrix,
    MatrixCell,
    MatrixRow,
    ablation_table,
    bars_table,
    confusion_table,
    follow_up_table,
    matrix_of,
)
from rfca_rig.reports.html_table import (
    NUMBER,
    WORDS,
    HtmlCell,
    HtmlColumn,
    HtmlFoot,
    as_html,
    card_table,
)
from rfca_rig.reports.provenance import Origin, command_line, version_text
from rfca_rig.reports.sections import PageSection, SideBySide
from rfca_rig.reports.table import Table, TableColumn, TableRow, table_files, write_all
from rfca_rig.reports.table import as_csv as table_as_csv
from rfca_rig.reports.templates import render_page
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

GOALS = (
    HtmlColumn("Result", card=""),
    HtmlColumn("Score", WORDS, card=""),
    HtmlColumn("Goal", "goal", card="goal"),
    HtmlColumn("Reached", NUMBER, card="reached"),
    HtmlColumn("Counts", NUMBER, card="counts"),
    HtmlColumn("With 95 % confidence", f"{NUMBER} goal", card="95 % bound"),
)
WORST_ANSWERS = (
    HtmlColumn("Case", card=""),
    HtmlColumn("Kind", card="kind"),
    HtmlColumn("What is wrong about it", WORDS, card=""),
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
    goals = bars(marks)
    beside = (_calibration(marks), _power(exam), _errors(exam), _misfit_removed(exam))
    sections = [
        _goals(goals),
        _follow_ups(exam),
        _removed_effects(exam),
        _outcomes(marks),
        _confusion(exam.cases),
        SideBySide("pairs", [[section] for section in beside if section is not None]),
        _worst(marks),
        _method(exam.cases),
    ]
    title = f"Blind benchmark of the diagnosis: {exam.words}, rfca-rig {__version__}"
    return render_page(
        title,
        _opening(title, exam, goals),
        sections,
        Origin(_command_line(exam), (), version, "of the same cases"),
        files,
        sheets=("verdict.css", "exam.css"),
    )


def _opening(title: str, exam: ExamResult, goals: Sequence[ScoreGoal]) -> Markup:
    judged = [goal for goal in goals if goal.passed is not None]
    passed = [goal for goal in judged if goal.passed]
    if len(passed) == len(judged):
        css = "all"
        stamp = "all goals reached"
    else:
        css = ""
        stamp = "not all goals reached"
    stated = verdict(
        css,
        stamp,
        _sentence(exam.marks, len(exam.cases)),
        _detection(exam.marks),
        f"{len(passed)} of {len(judged)}",
        "goals reached",
    )
    return join("\n", [paragraph(html("{} {}", title, mark("SIM")), "of"), stated])


def _goals(goals: Sequence[ScoreGoal]) -> PageSection:
    text = (
        f"Detectable: shifts the forces by more than {DETECTABLE:g} times the noise of a sample "
        "beyond what nominal values can explain. With 95 % confidence: the worst share that these "
        "counts allow."
    )
    goals_table = card_table("goals", GOALS, [_goal(goal) for goal in goals], css="goals")
    return PageSection("Goals", [goals_table, aside(text)])


def _goal(goal: ScoreGoal) -> tuple[str | HtmlCell, ...]:
    limits = [("at least", goal.at_least), ("at most", goal.at_most)]
    # A limit above 1 is no share, but a mean number, and is not shown in percent.
    text: Callable[[float], str] = share_text
    value = share_text(goal.value, trimmed=False)
    if any(limit is not None and limit > 1.0 for _, limit in limits):
        text = _plain
        value = _plain(goal.value)
    bound = ""
    if goal.bound is not None and goal.at_least is not None:
        bound = f"above {text(goal.bound)}"
    elif goal.bound is not None:
        bound = f"below {text(goal.bound)}"
    css = PASSED[goal.passed]
    return (
        HtmlCell("no case" if css == "none" else css, css),
        goal.name,
        " and ".join(f"{word} {text(limit)}" for word, limit in limits if limit is not None),
        value,
        goal.counted,
        bound,
    )


def _follow_ups(exam: ExamResult) -> PageSection | None:
    ways = [replace(way, arm=ARM_WORDS.get(way.arm, way.arm)) for way in exam.ways]
    if not ways:
        return None
    return PageSection("Follow-up experiments", [as_html(follow_up_table(ways))])


def _removed_effects(exam: ExamResult) -> PageSection | None:
    if not exam.taken_out:
        return None
    removed = ablation_table(exam.taken_out)
    if removed.rows:
        content = as_html(removed)
    else:
        content = paragraph(removed.caption)
    return PageSection("Effects removed from the catalogue", [content])


def _outcomes(marks: ExamScores) -> PageSection:
    words = [OUTCOME_WORDS.get(word, word) for word in OUTCOMES]
    columns = (
        HtmlColumn("Kind", card=""),
        HtmlColumn("Cases", NUMBER, card="cases"),
        *(HtmlColumn(word, NUMBER) for word in words),
    )
    rows: list[tuple[str | HtmlCell, ...]] = []
    totals = [0] * len(OUTCOMES)
    for kind, by_outcome in marks.outcomes.items():
        counts = [by_outcome.get(word, 0) for word in OUTCOMES]
        totals = [total + count for total, count in zip(totals, counts, strict=True)]
        cells = [_count_cell(count) for count in counts]
        rows.append((KIND_WORDS.get(kind, kind), str(sum(by_outcome.values())), *cells))
    feet = [HtmlCell(str(count), NUMBER) for count in (sum(totals), *totals)]
    outcomes = card_table(
        "outcomes by kind of case", columns, rows, [HtmlFoot("all", 1, tuple(feet))]
    )
    meanings = [(OUTCOME_WORDS.get(word, word), meaning) for word, meaning in MEANINGS.items()]
    return PageSection("Outcomes by kind of case", [outcomes, pairs(meanings, "small")])


def _count_cell(count: int) -> HtmlCell:
    if count:
        return HtmlCell(str(count), NUMBER)
    return HtmlCell("·", f"{NUMBER} zero")


def _confusion(scored: Sequence[ScoredCase]) -> PageSection | None:
    matrix = matrix_of(scored)
    if not matrix.kinds:
        return None
    colours = legend(
        legend_box("right", "right"),
        legend_box("in its indistinguishable set", "class"),
        legend_box("none identified", "other"),
        legend_box("wrong effect", "wrong"),
        html(
            "<span>Rows: hidden effect. Columns: identified effect, then answers without one."
            "</span>"
        ),
    )
    return PageSection("Confusion matrix", [colours, _matrix_as_html(matrix)])


def _matrix_as_html(matrix: Matrix) -> Markup:
    heads = [html('<th scope="col"><span>{}</span></th>', _words(name)) for name in matrix.names]
    for index, verdict_key in enumerate(matrix.verdicts):
        css = css_class("" if index else "apart")
        words = VERDICT_WORDS.get(verdict_key, verdict_key)
        heads.append(html('<th scope="col"{}><span>{}</span></th>', css, words))
    return html(
        '<div class="wide" tabindex="0" role="region" aria-label="confusion matrix">\n'
        '<table class="matrix">\n<thead><tr><th scope="col">Hidden</th>{}</tr></thead>\n{}\n'
        "</table>\n</div>",
        join("", heads),
        join("\n", [_matrix_kind(matrix, kind, rows) for kind, rows in matrix.kinds]),
    )


def _matrix_kind(matrix: Matrix, kind: str, rows: Sequence[MatrixRow]) -> Markup:
    width = str(1 + len(matrix.names) + len(matrix.verdicts))
    pattern = '<tr><th scope="rowgroup" class="kind" colspan="{}">{}</th></tr>'
    lines = [html(pattern, width, KIND_WORDS.get(kind, kind))]
    for row in rows:
        cells = [_matrix_cell(matrix, index, cell) for index, cell in enumerate(row.cells)]
        pattern = '<tr><th scope="row">{}</th>{}</tr>'
        lines.append(html(pattern, _words(row.concealed), join("", cells)))
    return html("<tbody>\n{}\n</tbody>", join("\n", lines))


def _matrix_cell(matrix: Matrix, index: int, cell: MatrixCell | None) -> Markup:
    apart = " apart" if index == len(matrix.names) else ""
    if cell is None:
        return html("<td{}></td>", css_class(apart.strip()))
    # A phone lists the cells of a row with the names of their columns.
    name = _words((*matrix.names, *matrix.verdicts)[index])
    css = css_class(f"{cell.shade or 'other'}{apart}")
    return html('<td data-head="{}"{}>{}</td>', name, css, str(cell.count))


def _words(name: str) -> str:
    return name.replace("_", " ")


def _calibration(marks: ExamScores) -> PageSection | None:
    if not marks.calibration.bins:
        return None
    text = (
        "Share of identified effects that are right, by stated probability in tenths. Dashed: "
        "perfect calibration. Bars: 90 % intervals; numbers: identified effects. "
        f"{_calibration_sentence(marks)}"
    )
    drawn = bare_figure(draw_reliability(marks.calibration))
    return PageSection("Calibration of probabilities", [drawn, aside(text)])


def _power(exam: ExamResult) -> PageSection | None:
    if not any(case.kind == cases.SINGLE for case in exam.cases):
        return None
    text = (
        "Cases with one effect, by its strength; numbers: cases. Stated right at any grade, by "
        "multiples of the detection limit in noise and usual model error: "
        f"{_power_sentence(exam.marks)}."
    )
    boxes = [legend_box(words, style=f"background: {colour}") for _, colour, words in PARTS]
    drawn = bare_figure(draw_power(exam.cases))
    return PageSection("Detection by size of the effect", [legend(*boxes), drawn, aside(text)])


def _errors(exam: ExamResult) -> PageSection | None:
    if not exam.marks.values.count:
        return None
    text = (
        f"{_values_sentence(exam.marks)} Errors relative to what the effect changes: a gain of "
        "1.03 found as 1.02 is off by a third."
    )
    measured = "background: var(--measured); border-color: var(--measured)"
    whole = "background: var(--faint); border-color: var(--faint)"
    colours = legend(
        legend_box("truth inside the 90 % interval", "dot", measured),
        legend_box("outside", "dot", "border-color: var(--bad)"),
        legend_box("a whole number", "dot", whole),
    )
    drawn = bare_figure(draw_parameter_errors(exam.cases))
    return PageSection("Errors of parameters", [colours, drawn, aside(text)])


def _misfit_removed(exam: ExamResult) -> PageSection | None:
    if not exam.marks.gap_worse.of:
        return None
    text = (
        "Share of the rms residual of fz, above the noise floor, that right answers remove on "
        f"held-out conditions. {_gap_sentence(exam.marks)}"
    )
    drawn = bare_figure(draw_gaps(exam.cases))
    return PageSection("Misfit removed on held-out conditions", [drawn, aside(text)])


def _worst(marks: ExamScores) -> PageSection:
    if not marks.worst:
        text = "None: no wrong effect, none missed, no value off by half."
        return PageSection("Worst answers", [paragraph(text)])
    rows = [
        (
            link(f"diagnoses/{miss.case}/diagnosis.html", miss.case),
            KIND_WORDS.get(miss.kind, miss.kind),
            miss.reason,
        )
        for miss in marks.worst
    ]
    text = (
        f"At most {MAX_LISTED}: wrong effects first, then missed effects by size, then wrong "
        "values."
    )
    return PageSection(
        "Worst answers", [card_table("worst answers", WORST_ANSWERS, rows), aside(text)]
    )


def _method(scored: Sequence[ScoredCase]) -> PageSection:
    pattern = (
        "The campaigns come from a simulator that shares no code with the model. Hidden effects "
        "were drawn from the seed. Their hashes were written to {} before the first campaign. "
        "Every campaign was diagnosed with {}. Only then were the hidden effects read and "
        "compared with their hashes. {}"
    )
    text = html(pattern, code("seals.txt"), code("rfca-rig diagnose"), _time(scored))
    return PageSection("Method", [paragraph(text)])


def share_text(value: float, trimmed: bool = True) -> str:
    """A share in percent, as in "2.5 %"; a trailing ".0" is removed where `trimmed`."""
    if not isfinite(value):
        return NOTHING
    text = number(100.0 * value, 1)
    if trimmed:
        text = text.removesuffix(".0")
    return f"{text}{NO_BREAK}%"


def _sentence(marks: ExamScores, count: int) -> str:
    """Headline: number of cases, and of wrong effects, which are the worst answers."""
    names = marks.false_discoveries
    null = marks.null_false_claims
    text = f"{count_noun(count, 'campaign')} of another simulator with hidden effects: "
    if names.of:
        were = "was" if names.of == 1 else "were"
        text += f"{names.hits} of {count_noun(names.of, 'identified effect')} {were} wrong"
    else:
        text += "no effect was identified"
    if null.of:
        return (
            f"{text}; in {null.hits or 'none'} of {null.of} campaigns without one, an effect "
            "was identified."
        )
    return f"{text}."


def _plain(value: float) -> str:
    if isfinite(value):
        return number(value, 1)
    return NOTHING


def _power_sentence(marks: ExamScores) -> str:
    """Detection rate by size of the effect, as in "below 0.5: 0 of 3; from 0.5: 1 of 2"."""
    limits = (f"below {POWER_AT[0]:g}", *(f"from {at:g}" for at in POWER_AT))
    return "; ".join(
        f"{limit}: {share.hits} of {share.of}"
        for limit, share in zip(limits, marks.power, strict=True)
        if share.of
    )


def _calibration_sentence(marks: ExamScores) -> str:
    scores = marks.calibration
    return (
        f"Calibration error {share_text(scores.ece)}, Brier score {number(scores.brier, 3)}, "
        f"logarithmic score {number(scores.log_score, 3)}."
    )


def _values_sentence(marks: ExamScores) -> str:
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


def _gap_sentence(marks: ExamScores) -> str:
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
    only = None
    if len(numbers) == 1:
        only = next(iter(numbers))
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
    tables = [bars_table(bars(exam.marks)), follow_up_table(exam.ways)]
    if exam.taken_out:
        tables.append(ablation_table(exam.taken_out))
    tables.append(confusion_table(exam.cases))
    contents = {"exam.json": as_json(exam), "exam.csv": as_csv(exam), **table_files(tables)}
    write_all(out, {"exam.html": page(exam, tuple(contents), version_text()), **contents})


def as_csv(exam: ExamResult) -> str:
    """A line for each case. Several effects are joined by +; the probability is that of the
    least certain name.
    """
    rows = tuple(TableRow(dict(zip(HEADER, _line(case), strict=True))) for case in exam.cases)
    return table_as_csv(Table("exam", "", tuple(TableColumn(name) for name in HEADER), rows))


def _line(case: ScoredCase) -> list[str]:
    probability = ""
    if case.probabilities:
        probability = f"{min(case.probabilities):.4f}"
    seconds = ""
    if case.seconds is not None:
        seconds = f"{case.seconds:.1f}"
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
    taken_out = None
    if exam.taken_out:
        taken_out = _plain_scores(exam.taken_out)
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
        "marks": _plain_scores(exam.marks) | {"confusion": confused},
        "follow_ups": [asdict(way) for way in exam.ways],
        "taken_out": taken_out,
        "cases": [asdict(case) for case in exam.cases],
    }
    return json.dumps(to_json_types(document), indent=1, ensure_ascii=False, allow_nan=False) + "\n"


def _plain_scores(scores: Any) -> dict[str, object]:
    """The fields of a dataclass of scores."""
    return {field.name: _plain_score(getattr(scores, field.name)) for field in fields(scores)}


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
    if hasattr(value, "__dataclass_fields__"):
        return asdict(value)  # type: ignore[call-overload]
    return value
