"""Confusion matrix of an exam: hidden effects in rows, answers in columns."""

from collections.abc import Sequence
from dataclasses import dataclass

from rfca_rig.exam import cases
from rfca_rig.exam.answer import VERDICTS
from rfca_rig.exam.outcome import CLASS, EXTRA, RIGHT, WRONG
from rfca_rig.exam.scored import ScoredCase
from rfca_rig.exam.sizes import SIZE_RANGES

SEVERAL = "several names"
# Kinds of cases with one hidden effect or none. Cases with several have no single row.
ROWS_OF = (cases.SINGLE, cases.WRONG_LAW, cases.STRANGER, cases.MISLABEL, cases.NOTHING, cases.MODEL_ERROR)
SHADES = {RIGHT: "right", CLASS: "class", WRONG: "wrong", EXTRA: "wrong"}
WORST_FIRST = ("wrong", "", "class", "right")


@dataclass(frozen=True)
class MatrixCell:
    """Number of cases; `shade` is that of the worst answer among them, "" for one that is neither right nor a false name."""

    count: int
    shade: str


@dataclass(frozen=True)
class MatrixRow:
    """A hidden effect, and a cell for each column; None for a cell without cases."""

    concealed: str
    cells: tuple[MatrixCell | None, ...]


@dataclass(frozen=True)
class Matrix:
    """Rows by kind of case. The columns are effects (`names`), then answers without a single name (`verdicts`)."""

    names: tuple[str, ...]
    verdicts: tuple[str, ...]
    kinds: tuple[tuple[str, tuple[MatrixRow, ...]], ...]


def matrix_of(marked: Sequence[ScoredCase]) -> Matrix:
    """Matrix of the kinds with one hidden effect or none; empty columns are omitted."""
    shown = [case for case in marked if case.kind in ROWS_OF]
    answers = {_answer(case) for case in shown}
    names = tuple(name for name in SIZE_RANGES if name in answers) + tuple(sorted(answers - set(SIZE_RANGES) - {SEVERAL, *VERDICTS}))
    verdicts = tuple(each for each in (SEVERAL, *VERDICTS) if each in answers)
    by_kind = [(kind, [case for case in shown if case.kind == kind]) for kind in ROWS_OF]
    return Matrix(names, verdicts, tuple((kind, _rows(of_kind, (*names, *verdicts))) for kind, of_kind in by_kind if of_kind))


def _answer(case: ScoredCase) -> str:
    if len(case.named) > 1:
        return SEVERAL
    return case.named[0] if case.named else case.verdict


def _rows(marked: Sequence[ScoredCase], columns: Sequence[str]) -> tuple[MatrixRow, ...]:
    hidden_effects = sorted({_hidden(case) for case in marked}, key=_place)
    return tuple(_row(name, [case for case in marked if _hidden(case) == name], columns) for name in hidden_effects)


def _hidden(case: ScoredCase) -> str:
    return " and ".join(case.concealed) or "nothing"


def _place(name: str) -> tuple[int, str]:
    """Sort key that puts effects in the order of the columns, so that right answers are on the diagonal."""
    return (list(SIZE_RANGES).index(name), "") if name in SIZE_RANGES else (len(SIZE_RANGES), name)


def _row(name: str, marked: Sequence[ScoredCase], columns: Sequence[str]) -> MatrixRow:
    return MatrixRow(name, tuple(_cell([case for case in marked if _answer(case) == column]) for column in columns))


def _cell(marked: Sequence[ScoredCase]) -> MatrixCell | None:
    if not marked:
        return None
    shades = [SHADES.get(case.outcome, "") for case in marked]
    return MatrixCell(len(marked), min(shades, key=WORST_FIRST.index))
