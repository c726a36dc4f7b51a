"""Tables independent of their format: CSV for programs, LaTeX for a paper, HTML for a page, plain text for a terminal."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import groupby
from math import isfinite
from typing import Literal

from rfca_rig.report.named_units import words_and_unit

Value = float | int | str | bool | None
Role = Literal["value", "kept", "group", "note"]


@dataclass(frozen=True)
class TableColumn:
    """One column of a table.

    Parameters
    ----------
    key
        Name in CSV, which ends in the unit.
    head
        Heading for a reader; by default the key in words.
    digits
        Decimals of numbers; by default as many as show two digits of the uncertainty.
    half
        Key of the column with the uncertainty: one standard deviation or half an interval, as the table's caption states.
    over
        Heading above this one, common to neighbouring columns.
    role
        A "kept" column is in CSV only, a "group" divides the rows, a "note" is shown below its row.
    set_value
        The values were chosen, not measured, and are shown as they were typed.
    upright
        The heading is rotated by 90 degrees in LaTeX, for tables with many columns.
    """

    key: str
    head: str = ""
    digits: int | None = None
    half: str = ""
    over: str = ""
    role: Role = "value"
    set_value: bool = False
    upright: bool = False

    @property
    def title(self) -> str:
        """Heading for a reader."""
        return self.head or words_and_unit(self.key)[0]

    @property
    def unit(self) -> str:
        """Unit from the key, "" for none."""
        return words_and_unit(self.key)[1]


@dataclass(frozen=True)
class TableRow:
    """Values by the keys of the columns; missing ones and None are unknown. `digits` overrides that of the columns.

    A `marked` row needs attention, and is highlighted.
    """

    values: Mapping[str, Value]
    digits: int | None = None
    marked: bool = False


@dataclass(frozen=True)
class Foot:
    """A line below the rows: words across the first columns, then values by their keys."""

    words: str
    values: Mapping[str, Value] = field(default_factory=dict)
    digits: int | None = None


@dataclass(frozen=True)
class Table:
    """A table; `name` is that of its files. The `caption` states what is shown, over how many repeats, and the meaning of ±."""

    name: str
    caption: str
    columns: tuple[TableColumn, ...]
    rows: tuple[TableRow, ...]
    foot: tuple[Foot, ...] = ()

    @property
    def shown(self) -> tuple[TableColumn, ...]:
        """Columns that a reader sees; CSV has all."""
        return tuple(column for column in self.columns if column.role == "value")

    @cached_property
    def numeric(self) -> frozenset[str]:
        """Keys of the columns that hold numbers, which are aligned right."""
        return frozenset(column.key for column in self.columns if any(_is_number(row.values.get(column.key)) for row in self.rows))

    def groups(self) -> list[tuple[str, tuple[TableRow, ...]]]:
        """The rows by their group; without a name where there is only one."""
        # groupby joins neighbours only, so that rows keep their order.
        key = next((column.key for column in self.columns if column.role == "group"), "")
        groups = [(str(name), tuple(rows)) for name, rows in groupby(self.rows, lambda row: row.values.get(key) or "")]
        return groups if len(groups) > 1 else [("", self.rows)]

    def notes(self, row: TableRow) -> list[str]:
        """Notes below a row, a line each."""
        texts = (row.values.get(column.key) for column in self.columns if column.role == "note")
        return [str(text) for text in texts if text]

    def overs(self) -> list[tuple[str, int]]:
        """Headings above the columns with the number of columns each spans, "" where there is none; empty without any heading."""
        spans = [(over, len(list(columns))) for over, columns in groupby(self.shown, lambda column: column.over)]
        return spans if any(over for over, _ in spans) else []


@dataclass(frozen=True)
class TableCell:
    """A value as text with an ASCII minus sign; `half` is the uncertainty after ±, "" for none. Both are "" for an unknown value."""

    text: str
    half: str = ""
    is_number: bool = False


def cell(column: TableColumn, row: TableRow) -> TableCell:
    """The value of a column in a row as text, with its uncertainty where there is one."""
    value, half = row.values.get(column.key), row.values.get(column.half) if column.half else None
    if value is None or (isinstance(value, float) and not isfinite(value)):
        return TableCell("")
    if isinstance(value, bool | str):
        return TableCell(value if isinstance(value, str) else ("yes" if value else "no"))
    if column.set_value:
        return TableCell(f"{value:.6g}", is_number=True)
    known = float(half) if isinstance(half, int | float) and isfinite(half) and half > 0 else None
    digits = _digits(value, known, column.digits if row.digits is None else row.digits)
    return TableCell(format_rounded(value, digits), "" if known is None else format_rounded(known, digits), is_number=True)


def foot_cell(column: TableColumn, foot: Foot) -> TableCell:
    """The value of a column in a foot as text."""
    return cell(column, TableRow(foot.values, foot.digits))


def head_span(table: Table, foot: Foot) -> int:
    """Number of shown columns before the first value of a foot, which its words may span."""
    return next((place for place, column in enumerate(table.shown) if column.key in foot.values), len(table.shown))


def format_rounded(value: float, digits: int) -> str:
    """A value with `digits` decimals, negative ones for tens and hundreds; no minus where all digits shown are zero."""
    # Adding 0.0 turns the -0.0 that rounding leaves into 0.0.
    return f"{round(value, digits) + 0.0:.{max(digits, 0)}f}"


def _digits(value: float, half: float | None, asked: int | None) -> int:
    if asked is not None:
        return asked
    if isinstance(value, int):
        return 0
    return places(half, 2) if half is not None else places(value, 4)


def places(size: float, digits: int) -> int:
    """Decimals that show `size` with so many digits; negative where it is rounded to tens or hundreds."""
    # The exponent of the formatted text, which is rounded to seven digits first: 999.99999999 counts as 1000.
    return digits - 1 - (int(f"{abs(size):e}".partition("e")[2]) if size and isfinite(size) else 0)


def _is_number(value: Value) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)


def with_common_decimals(column: TableColumn, rows: Sequence[TableRow]) -> TableColumn:
    """The column with the same decimals in all rows, as many as show two digits of the median uncertainty."""
    halves = [row.values.get(column.half) for row in rows]
    known = sorted(float(half) for half in halves if isinstance(half, int | float) and isfinite(half) and half > 0)
    return replace(column, digits=max(places(known[len(known) // 2], 2), 0)) if known else column
