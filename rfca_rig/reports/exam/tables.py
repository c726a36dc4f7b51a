"""Tables of an exam: required scores (bars), results of follow-up experiments, ablation of the
catalogue, and the confusion matrix.

The matrix has hidden effects in rows, answers in columns.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from math import isfinite

from rfca_rig.exam import cases
from rfca_rig.exam.answer import CAUTIOUS, CLASS, EXTRA, NAMED, RIGHT, SILENT, VERDICTS, WRONG
from rfca_rig.exam.cases import SIZE_RANGES
from rfca_rig.exam.follow_up import RANDOM, AblationResult, ArmResult
from rfca_rig.exam.pendulums.cases import PENDULUM_STRANGER
from rfca_rig.exam.scored import ScoredCase
from rfca_rig.exam.scoring import ScoreGoal
from rfca_rig.reports.table import Table, TableColumn, TableRow, Value

SEVERAL = "several effects"
# Kinds of cases with one hidden effect or none. Cases with several have no single row.
ROWS_OF = (
    cases.SINGLE,
    cases.WRONG_LAW,
    cases.STRANGER,
    cases.MISLABEL,
    cases.NOTHING,
    cases.MODEL_ERROR,
)
# Words of the page for kinds of cases whose key in files and on the command line is no term of the
# field.
KIND_WORDS = {
    cases.STRANGER: "effect outside the catalogue",
    PENDULUM_STRANGER: "pendulum, effect outside the catalogue",
}
# The same for outcomes.
OUTCOME_WORDS = {CLASS: "in set", EXTRA: "extra effect", SILENT: "missed", CAUTIOUS: "inconclusive"}
VERDICT_WORDS = {NAMED: "identified"}
ARM_WORDS = {RANDOM: "at random"}
SHADES = {RIGHT: "right", CLASS: "class", WRONG: "wrong", EXTRA: "wrong"}
WORST_FIRST = ("wrong", "", "class", "right")

PASSED = {True: "passed", False: "failed", None: "no case"}


@dataclass(frozen=True)
class MatrixCell:
    """Number of cases; `shade` is that of the worst answer among them, "" for one that is
    neither right nor a wrong effect.
    """

    count: int
    shade: str


@dataclass(frozen=True)
class MatrixRow:
    """A hidden effect, and a cell for each column; None for a cell without cases."""

    concealed: str
    cells: tuple[MatrixCell | None, ...]


@dataclass(frozen=True)
class Matrix:
    """Rows by kind of case. The columns are effects (`names`), then answers without a single
    name (`verdicts`).
    """

    names: tuple[str, ...]
    verdicts: tuple[str, ...]
    kinds: tuple[tuple[str, tuple[MatrixRow, ...]], ...]


def matrix_of(marked: Sequence[ScoredCase]) -> Matrix:
    """Matrix of the kinds with one hidden effect or none; empty columns are omitted."""
    shown = [case for case in marked if case.kind in ROWS_OF]
    answers = {_answer(case) for case in shown}
    names = tuple(name for name in SIZE_RANGES if name in answers) + tuple(
        sorted(answers - set(SIZE_RANGES) - {SEVERAL, *VERDICTS})
    )
    verdicts = tuple(verdict for verdict in (SEVERAL, *VERDICTS) if verdict in answers)
    kinds = []
    for kind in ROWS_OF:
        of_kind = [case for case in shown if case.kind == kind]
        if of_kind:
            kinds.append((kind, _rows(of_kind, (*names, *verdicts))))
    return Matrix(names, verdicts, tuple(kinds))


def _answer(case: ScoredCase) -> str:
    if len(case.named) > 1:
        return SEVERAL
    if case.named:
        return case.named[0]
    return case.verdict


def _rows(marked: Sequence[ScoredCase], columns: Sequence[str]) -> tuple[MatrixRow, ...]:
    hidden_effects = sorted({_hidden(case) for case in marked}, key=_place)
    rows = []
    for name in hidden_effects:
        of_name = [case for case in marked if _hidden(case) == name]
        rows.append(_row(name, of_name, columns))
    return tuple(rows)


def _hidden(case: ScoredCase) -> str:
    return " and ".join(case.concealed) or "nothing"


def _place(name: str) -> tuple[int, str]:
    """Sort key that puts effects in the order of the columns, so that right answers are on the
    diagonal.
    """
    if name in SIZE_RANGES:
        return (list(SIZE_RANGES).index(name), "")
    return (len(SIZE_RANGES), name)


def _row(name: str, marked: Sequence[ScoredCase], columns: Sequence[str]) -> MatrixRow:
    cells = []
    for column in columns:
        answered = [case for case in marked if _answer(case) == column]
        cells.append(_cell(answered))
    return MatrixRow(name, tuple(cells))


def _cell(marked: Sequence[ScoredCase]) -> MatrixCell | None:
    if not marked:
        return None
    shades = [SHADES.get(case.outcome, "") for case in marked]
    return MatrixCell(len(marked), min(shades, key=WORST_FIRST.index))


def bars_table(all_bars: Sequence[ScoreGoal]) -> Table:
    """Required scores: goal, value reached, counts, and the worst value that is still compatible
    at 95 % confidence.
    """
    rows = tuple(TableRow(_bar(bar), marked=bar.passed is False) for bar in all_bars)
    columns = (
        TableColumn("mark", "Score"),
        TableColumn("goal", "Goal"),
        TableColumn("reached", "Reached", set_value=True),
        TableColumn("counts", "Counts"),
        TableColumn("bound_95", "With 95 % confidence", set_value=True),
        TableColumn("passed", "Passed"),
    )
    return Table(
        "bars",
        (
            "Shares of cases; the last column is the worst share that these counts allow, at "
            "95 % confidence."
        ),
        columns,
        rows,
    )


def _bar(bar: ScoreGoal) -> dict[str, Value]:
    goal = " and ".join(
        f"{word} {limit:g}"
        for word, limit in (("at least", bar.at_least), ("at most", bar.at_most))
        if limit is not None
    )
    if isfinite(bar.value):
        reached = float(f"{bar.value:.4g}")
    else:
        reached = None
    bound = None
    if bar.bound is not None:
        bound = float(f"{bar.bound:.3g}")
    return {
        "mark": bar.name,
        "goal": goal,
        "reached": reached,
        "counts": bar.counted,
        "bound_95": bound,
        "passed": PASSED[bar.passed],
    }


def follow_up_table(ways: Sequence[ArmResult]) -> Table:
    """Experiments that were proposed in undecided cases, compared with other choices."""
    rows = tuple(
        TableRow(
            {
                "arm": way.arm,
                "settled": f"{way.settled} of {way.of}",
                "experiments": way.experiments,
            }
        )
        for way in ways
    )
    columns = (
        TableColumn("arm", "Next experiments"),
        TableColumn("settled", "Settled"),
        TableColumn("experiments", "Experiments on average", digits=2),
    )
    caption = (
        "Cases of too few recordings, with no hidden effect or a detectable one. "
        "Settled: the right verdict without an equal rival, "
        "within four experiments; four are counted where it was not."
    )
    return Table("next-experiments", caption, columns, rows)


def ablation_table(found: AblationResult) -> Table:
    """Effects that were identified as another one after they had been removed from the
    catalogue.
    """
    columns = (
        TableColumn("concealed", "Hidden"),
        TableColumn("named", "Identified as"),
        TableColumn("probability", "Probability", digits=3),
    )
    caption = f"{found.words[0].upper()}{found.words[1:]}."
    rows = (
        TableRow(
            {
                "concealed": mistake.effect.replace("_", " "),
                "named": " and ".join(mistake.named).replace("_", " "),
                "probability": mistake.probability,
            }
        )
        for mistake in found.named
    )
    return Table("taken-out", caption, columns, tuple(rows))


def confusion_table(marked: Sequence[ScoredCase]) -> Table:
    """Confusion matrix: numbers of cases by hidden effect (rows) and answer (columns); empty
    where there is no case.
    """
    matrix = matrix_of(marked)
    names = (*matrix.names, *matrix.verdicts)
    columns = tuple(
        TableColumn(name.replace(" ", "_"), name.replace("_", " "), upright=True) for name in names
    )
    rows = []
    for kind, matrix_rows in matrix.kinds:
        for row in matrix_rows:
            counts = {
                column.key: cell.count if cell else None
                for column, cell in zip(columns, row.cells, strict=True)
            }
            concealed = row.concealed.replace("_", " ")
            rows.append(TableRow({"kind": kind, "concealed": concealed, **counts}))
    caption = (
        "Numbers of cases: rows are hidden effects, columns identified effects, the last of "
        "them answers without one."
    )
    return Table(
        "confusion",
        caption,
        (TableColumn("kind", role="group"), TableColumn("concealed", "Hidden"), *columns),
        tuple(rows),
    )
