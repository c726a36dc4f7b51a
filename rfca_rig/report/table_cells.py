"""Tables for HTML: typographic minus signs, an en dash for unknown numbers, no line break between a number and its uncertainty."""

from dataclasses import dataclass

from rfca_rig.report.table import Foot, Table, TableCell, TableColumn, TableRow, cell, foot_cell, head_span
from rfca_rig.report.text import MINUS, NO_BREAK, NOTHING, in_thousands


@dataclass(frozen=True)
class ShownCell:
    """Text of a cell; `right` aligns a column of numbers."""

    text: str
    right: bool


@dataclass(frozen=True)
class ShownRow:
    """One row with the notes below it."""

    cells: tuple[ShownCell, ...]
    marked: bool
    notes: tuple[str, ...]


@dataclass(frozen=True)
class ShownFoot:
    """A foot: `words` across `span` columns, then the other cells."""

    words: str
    span: int
    cells: tuple[ShownCell, ...]


@dataclass(frozen=True)
class ShownTable:
    """Content for the macro `table` in parts.html."""

    heads: tuple[ShownCell, ...]
    units: tuple[str, ...]
    overs: tuple[tuple[str, int], ...]
    groups: tuple[tuple[str, tuple[ShownRow, ...]], ...]
    foot: tuple[ShownFoot, ...]


def cells_as_text(table: Table) -> ShownTable:
    """The table with every cell as text."""
    return ShownTable(
        heads=tuple(ShownCell(column.title, column.key in table.numeric) for column in table.shown),
        units=tuple(column.unit.replace(" ", NO_BREAK) for column in table.shown),
        overs=tuple(table.overs()),
        groups=tuple((name, tuple(_row(table, row) for row in rows)) for name, rows in table.groups()),
        foot=tuple(_foot(table, foot) for foot in table.foot),
    )


def _row(table: Table, row: TableRow) -> ShownRow:
    cells = tuple(_to_cell(table, column, cell(column, row)) for column in table.shown)
    return ShownRow(cells, row.marked, tuple(table.notes(row)))


def _foot(table: Table, foot: Foot) -> ShownFoot:
    span = head_span(table, foot)
    cells = tuple(_to_cell(table, column, foot_cell(column, foot)) for column in table.shown[span:])
    return ShownFoot(foot.words, span, cells)


def _to_cell(table: Table, column: TableColumn, found: TableCell) -> ShownCell:
    text = in_thousands(found.text).replace("-", MINUS) if found.is_number else found.text
    if found.half:
        text += f"{NO_BREAK}±{NO_BREAK}{found.half}"
    return ShownCell(text or (NOTHING if column.key in table.numeric else ""), column.key in table.numeric)
