"""A table of text and its cells as numbers. Clean files take a fast path; a slow path reads dates
and separated thousands, and searches the fault to report.
"""

import csv
import math
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from datetime import UTC, datetime
from functools import partial
from pathlib import Path
from typing import Protocol, TypeVar

import numpy as np
from numpy.typing import NDArray

from rfca_rig.campaign.dialect import (
    BLANKS,
    DATE_TIME,
    DECIMAL_COMMA,
    GROUPED,
    IN_WORDS,
    NUMBER,
    Dialect,
    detect_dialect,
    uncover_names,
    with_point,
)
from rfca_rig.campaign.file_kinds import (
    GZIP,
    LOOKED_AT,
    find_can_log,
    read_gzip,
    refuse_foreign,
)
from rfca_rig.campaign.recorded_columns import finite_or_none
from rfca_rig.errors import BadInput
from rfca_rig.executors.reading import (
    BYTES_PER_GIB,
    MEMORY_VARIABLE,
    read_within_limits,
    reading_limits,
)
from rfca_rig.toml import decode_text, read_bytes

Floats = NDArray[np.float64]
Result = TypeVar("Result")

# Of one recording; fewer are refused.
FEWEST_SAMPLES = 10
# share of samples with the time of the one above, from which it is no single repeated stamp
MANY_SAME = 0.2

_NOT_A_VALUE = re.compile(r"[+-]?(nan|inf|infinity|n/a|na|#.*)", re.IGNORECASE)
_ONE_GROUP = re.compile(r"[+-]?[1-9]\d{0,2},\d{3}")
_TWO_GROUPS = re.compile(r"[+-]?[1-9]\d{0,2}(,\d{3}){2,}(\.\d*)?")
_WHOLE = re.compile(r"[+-]?\d+")
# Bytes of memory for each byte of a table, while its text is split into lines and cells.
MEMORY_PER_BYTE = 8
# A table below takes less than a second, whatever it holds.
SMALL_BYTES = 4_000_000


@dataclass(frozen=True)
class CsvTable:
    """A table of text: the names of its columns, and the lines of its data unparsed.

    Parameters
    ----------
    path
        The file.
    names
        Names of the columns.
    lines
        The lines of data.
    dialect
        How the file holds the table.
    units
        The unit of each column that the file states, by name.
    notes
        What was read otherwise than in a plain table, a sentence each.
    """

    path: Path
    names: tuple[str, ...]
    lines: tuple[str, ...]
    dialect: Dialect
    units: Mapping[str, str] = field(default_factory=dict)
    notes: tuple[str, ...] = ()

    def fault(self, row: int, problem: str) -> BadInput:
        """The error for data line `row`, from 0."""
        return BadInput(f"{self.path}:{row + self.first_line}: {problem}")

    @property
    def header(self) -> str:
        """Where the names are, for messages."""
        return f"{self.path}:{self.dialect.names + 1}"

    @property
    def first_line(self) -> int:
        """Line of the first data in the file, from 1."""
        return self.dialect.first + 1

    def split(self, row: int) -> tuple[str, ...]:
        """The cells of data line `row`; none of an empty one."""
        return _split(self.path, self.dialect.first + row, self.lines[row], self.dialect)

    def find_name(self, name: str) -> int:
        """Number of the column of this name. Raises ValueError for an unknown name, and BadInput
        where two columns have it.
        """
        place = self.names.index(name)
        if self.names.count(name) > 1:
            other = self.names.index(name, place + 1)
            raise BadInput(
                f"{self.path}:{self.dialect.names + 1}: two columns are named {name} "
                f"({place + 1} and {other + 1}); rename one"
            )
        return place


def read_table(path: Path) -> CsvTable:
    """Read the file's header and lines. Raises BadInput for a file that is missing, empty, no text
    or no table.
    """
    lines, encoding_note = _read_lines(path)
    dialect = detect_dialect(lines)
    if len(lines) <= dialect.first:
        raise BadInput(f"{path}:1: holds column names and no data")
    _check_header(path, lines[dialect.names], dialect)
    first = _split(path, dialect.first, lines[dialect.first], dialect)
    last = _split(path, len(lines) - 1, lines[-1], dialect)
    names = _split(path, dialect.names, uncover_names(lines[dialect.names]), dialect)
    # A name of a column that no line has: a comma at the end of the line, or LabVIEW's comment.
    if len(names) == len(first) + 1 and names[-1].lower() in ("", "comment"):
        names = names[:-1]
    units = {}
    if dialect.units is not None:
        units = _list_units(names, _split(path, dialect.units, lines[dialect.units], dialect))
    units |= {
        name: "s" for name, cell in zip(names, first, strict=False) if DATE_TIME.fullmatch(cell)
    }
    notes = (
        *encoding_note,
        *_describe_dialect(dialect),
        *_describe_cells(names, first, last, dialect),
    )
    return CsvTable(path, names, tuple(lines[dialect.first :]), dialect, units, notes)


def _read_lines(path: Path) -> tuple[list[str], tuple[str, ...]]:
    """The lines of a file, of which the last is not empty, and a note on how its signs are read.
    Raises BadInput as `read_table`.
    """
    most_bytes = int(reading_limits().memory_GiB * BYTES_PER_GIB / MEMORY_PER_BYTE)
    content = read_bytes(path, most_bytes, f"raise {MEMORY_VARIABLE}, or split it")
    if content.startswith(GZIP):
        content = read_gzip(path, most_bytes)
        can_log = find_can_log(content[:LOOKED_AT])
        if can_log:
            raise BadInput(f"{path}: is a CAN log ({can_log}) packed by gzip; unpack it: gunzip")
    refuse_foreign(path, content[:LOOKED_AT])
    try:
        text = decode_text(path, content)
        notes: tuple[str, ...] = ()
    except BadInput:
        text = _decode_header(content)
        if not text:
            raise
        notes = ("the names are read as Windows-1252",)
    lines = _split_lines(text)
    if not lines:
        raise BadInput(f"{path}: is empty; it needs a line of column names and a line per sample")
    return lines, notes


def _split_lines(text: str) -> list[str]:
    """Lines with the ends of every operating system, without empty ones at the end."""
    lines = text.replace("\r\n", "\n").replace("\r", "\n").split("\n")
    while lines and not lines[-1].strip():
        lines.pop()
    return lines


def _decode_header(content: bytes) -> str:
    """The text of a file in Windows-1252 whose data are plain ASCII; "" for other files.

    LabVIEW and spreadsheets write the degree sign and umlauts of names so. In the data such a byte
    is damage.
    """
    try:
        text = content.decode("cp1252")
    except UnicodeDecodeError:
        return ""
    lines = _split_lines(text)
    first = detect_dialect(lines).first
    if all(line.isascii() for line in lines[first:]):
        return text
    return ""


def _check_header(path: Path, header: str, dialect: Dialect) -> None:
    """Raise BadInput for a first line of numbers: such a file would lose its first sample."""
    cells = _split(path, dialect.names, header, dialect)
    if cells and all(NUMBER.fullmatch(cell) for cell in cells):
        raise BadInput(
            f"{path}:{dialect.names + 1}: the first line holds numbers; it must name the columns"
        )


def _list_units(names: Sequence[str], units: Sequence[str]) -> dict[str, str]:
    """The unit of each column that the row of units states, without brackets."""
    stated = {name: unit.strip("[]()") for name, unit in zip(names, units, strict=False)}
    return {name: unit for name, unit in stated.items() if unit not in ("", "-")}


def _describe_dialect(dialect: Dialect) -> Sequence[str]:
    notes = []
    if dialect.names > 0:
        notes.append(f"the names are in line {dialect.names + 1}; the lines above it are not read")
    if dialect.units is not None:
        notes.append(f"line {dialect.units + 1} holds units")
    if dialect.separator != ",":
        notes.append(f"cells are separated by {IN_WORDS[dialect.separator]}")
    if dialect.decimal == ",":
        notes.append("numbers have a decimal comma")
    return notes


def _describe_cells(
    names: Sequence[str], first: Sequence[str], last: Sequence[str], dialect: Dialect
) -> Iterator[str]:
    """What the first and the last line of the data show, a sentence each."""
    for name, cell, last_cell in zip(names, first, last, strict=False):
        if DATE_TIME.fullmatch(cell):
            yield f"{name}: dates and times, as seconds since 1970"
        if dialect.decimal == "." and _TWO_GROUPS.fullmatch(last_cell):
            yield f"{name}: commas separate thousands"


def _split(path: Path, line: int, text: str, dialect: Dialect) -> tuple[str, ...]:
    """The cells of a line of the file, from 0; none of an empty one."""
    try:
        return dialect.split(text)
    except csv.Error as error:
        raise BadInput(f"{path}:{line + 1}: is no line of a table: {error}") from None


def columns(table: CsvTable, names: Sequence[str], gaps: Sequence[str] = ()) -> Floats:
    """These columns (rows, k) as finite numbers, whatever the others hold. Raises ValueError for
    an unknown name.

    Those of `gaps` may hold NaN, where a device gave no value.
    """
    places = [table.find_name(name) for name in names]
    with_gaps = frozenset(table.find_name(name) for name in gaps)
    return _read_bounded(table, partial(_numbers_in, table, places, with_gaps))


def find_counts(table: CsvTable) -> list[str]:
    """Columns whose first and last cells are whole numbers, written without a point. A column of
    other numbers has a point in its first cell, or in its last.
    """
    first = table.split(0)
    last = table.split(len(table.lines) - 1)
    cells = zip(table.names, first, last, strict=False)
    return [name for name, *ends in cells if all(map(_WHOLE.fullmatch, ends))]


def read_only_names(path: Path) -> tuple[str, ...]:
    """The names of a table that has no line of data; () of other files."""
    if path.suffix.lower() != ".csv" or path.stat().st_size > SMALL_BYTES:
        return ()
    lines, _ = _read_lines(path)
    if len(lines) > 1:
        return ()
    return _split(path, 0, lines[0], Dialect())


def _read_bounded(table: CsvTable, read: Callable[[], Result]) -> Result:
    """What `read` makes of a table, within the limits of time and memory where it is large
    enough to reach them.
    """
    is_small = sum(map(len, table.lines)) < SMALL_BYTES
    if is_small:
        return read()
    return read_within_limits(table.path, read)


def _numbers_in(
    table: CsvTable, places: Sequence[int], with_gaps: frozenset[int] = frozenset()
) -> Floats:
    values = _fast(table)
    if values is not None:
        whole = [place for place in places if place not in with_gaps]
        is_right = np.isfinite(values[:, whole]).all() and not np.isinf(values[:, places]).any()
        if is_right:
            return np.ascontiguousarray(values[:, places])
    cells = list(rows(table))
    faults = []
    columns = []
    for place in places:
        of_column = [line[place] for line in cells]
        if place in with_gaps:
            parsed = _parse_with_gaps(table, place, of_column)
        else:
            parsed = _parse_column(table, place, of_column)
        if isinstance(parsed, CellFault):
            faults.append(parsed)
        else:
            columns.append(parsed)
    if faults:
        first = min(faults, key=lambda fault: fault.row)
        raise table.fault(first.row, f"column {first.name}: {first.problem}")
    return np.column_stack(columns)


@dataclass(frozen=True)
class CellFault:
    """The first cell of a column that is no number: its data line, from 0, and why."""

    row: int
    name: str
    problem: str


def _parse_column(table: CsvTable, place: int, cells: Sequence[str]) -> Floats | CellFault:
    """The numbers (rows,) of one column, or its first fault.

    Dates and times become seconds since 1970.
    """
    name = table.names[place]
    if DATE_TIME.fullmatch(cells[0]):
        return _parse_times(name, cells)
    decimal = table.dialect.decimal
    # With two commas they can only separate thousands.
    has_groups = decimal == "." and any(map(_TWO_GROUPS.fullmatch, cells))
    numbers = np.empty(len(cells))
    for row, cell in enumerate(cells):
        text = with_point(cell, decimal)
        if has_groups and GROUPED.fullmatch(cell):
            text = cell.replace(",", "")
        if fault := _fault_in_number(text):
            return CellFault(row, name, fault)
        numbers[row] = float(text)
    return numbers


def _parse_with_gaps(table: CsvTable, place: int, cells: Sequence[str]) -> Floats | CellFault:
    """The same, NaN where a cell is NaN."""
    rows_with_value = [row for row, cell in enumerate(cells) if cell.lower() != "nan"]
    values = np.full(len(cells), np.nan)
    if rows_with_value:
        parsed = _parse_column(table, place, [cells[row] for row in rows_with_value])
        if isinstance(parsed, CellFault):
            return CellFault(rows_with_value[parsed.row], parsed.name, parsed.problem)
        values[rows_with_value] = parsed
    return values


def _parse_times(name: str, cells: Sequence[str]) -> Floats | CellFault:
    """Seconds since 1970 (rows,) of a column of dates and times."""
    times_s = np.empty(len(cells))
    for row, cell in enumerate(cells):
        try:
            moment = datetime.fromisoformat(cell.replace(",", "."))
        except ValueError:
            return CellFault(row, name, f"{cell[:30]!r} is no date and time")
        if moment.tzinfo is None:
            moment = moment.replace(tzinfo=UTC)
        times_s[row] = moment.timestamp()
    return times_s


def numeric_columns(table: CsvTable) -> dict[str, Floats | None]:
    """Every column (rows,) by its name, None where not all cells are finite numbers, or two columns
    have the name. Raises BadInput as `rows` does.
    """
    return _read_bounded(table, partial(_numeric_columns_in, table))


def _numeric_columns_in(table: CsvTable) -> dict[str, Floats | None]:
    values = _fast(table)
    columns: list[Floats | None] = []
    if values is not None:
        columns = [finite_or_none(column) for column in values.T]
    else:
        for place, cells in enumerate(zip(*rows(table), strict=True)):
            parsed = _parse_column(table, place, cells)
            columns.append(None if isinstance(parsed, CellFault) else parsed)
    by_name: dict[str, Floats | None] = {}
    for name, column in zip(table.names, columns, strict=True):
        by_name[name] = None if table.names.count(name) > 1 else column
    return by_name


def _fast(table: CsvTable) -> Floats | None:
    """All cells (rows, columns), None where some are not numbers or a line has another number of
    cells.
    """
    lines: Sequence[str] = table.lines
    if table.dialect.decimal == ",":
        lines = [line.replace(",", ".") for line in lines]
    delimiter: str | None = table.dialect.separator
    if delimiter == BLANKS:
        delimiter = None
    try:
        # loadtxt would otherwise drop the rest of a line after "#", and a fault with it.
        values = np.loadtxt(
            lines, delimiter=delimiter, dtype=np.float64, comments=None, quotechar='"', ndmin=2
        )
    except ValueError:
        return None
    if values.shape == (len(table.lines), len(table.names)):
        return values
    return None


def number(table: CsvTable, row: int, name: str, cell: str) -> float:
    """The cell in data line `row`, from 0, as a finite number. Raises BadInput naming line and
    column.
    """
    text = with_point(cell, table.dialect.decimal)
    if fault := _fault_in_number(text):
        raise table.fault(row, f"column {name}: {fault}")
    return float(text)


def rows(table: CsvTable) -> Iterator[tuple[str, ...]]:
    """The cells of each data line, as text without surrounding blanks. Raises BadInput for a
    line with another number of cells.
    """
    for row in range(len(table.lines)):
        cells = table.split(row)
        if len(cells) != len(table.names):
            raise table.fault(row, _wrong_count(len(cells), len(table.names)))
        yield cells


def _wrong_count(cells: int, columns: int) -> str:
    if cells == 0:
        return "the line is empty; remove it"
    if cells == 2 * columns:
        comma = "; do its numbers have a decimal comma? Export it again with a decimal point"
    else:
        comma = ""
    return f"{cells} cells in the line for {columns} columns in the header{comma}"


def _fault_in_number(cell: str) -> str | None:
    if not cell:
        return (
            "the cell is empty; every cell needs a number (leave out a column that was not "
            "measured)"
        )
    if _ONE_GROUP.fullmatch(cell):
        return (
            f"{cell} has a comma, which may be before the decimals or the thousands; export the "
            "file again with a decimal point and nothing between the thousands"
        )
    if DECIMAL_COMMA.fullmatch(cell):
        return f"{cell} has a decimal comma; export the file again with a decimal point"
    if DATE_TIME.fullmatch(cell):
        return f"{cell} is a date and time, and the cells above are numbers"
    if _NOT_A_VALUE.fullmatch(cell):
        return f"{cell} is not a value; every cell needs a finite number"
    if not NUMBER.fullmatch(cell):
        return f"{cell[:30]!r} is not a number"
    if math.isfinite(float(cell)):
        return None
    return f"{cell[:30]} is too large for a number"


class HasSamples(Protocol):
    """A recording that can name one of its samples, from 0, in an error message."""

    @property
    def path(self) -> Path: ...

    def fault(self, row: int, problem: str) -> BadInput: ...


def select_samples(
    recording: HasSamples, t_s: Floats, from_s: float | None, to_s: float | None
) -> NDArray[np.bool_]:
    """Mask (rows,) of the samples from `from_s` to `to_s`, for times `t_s` (rows,). Raises BadInput
    for times that do not rise, or too few.
    """
    backwards = np.flatnonzero(np.diff(t_s) <= 0.0)
    if backwards.size:
        row = int(backwards[0]) + 1
        raise recording.fault(row, f"time does not run forwards: {describe_step_back(t_s, row)}")
    if from_s is None:
        from_s = -np.inf
    if to_s is None:
        to_s = np.inf
    inside = (t_s >= from_s) & (t_s <= to_s)
    if inside.sum() < FEWEST_SAMPLES:
        raise BadInput(
            f"{recording.path}: {inside.sum()} samples between from_s and to_s; needs "
            f"{FEWEST_SAMPLES} or more"
        )
    return np.asarray(inside)


def describe_step_back(t_s: Floats, row: int) -> str:
    """In words, how the time of sample `row` of the times (m,) does not rise, and the probable
    cause.
    """
    back_s = float(t_s[row - 1] - t_s[row])
    if back_s > 0.0:
        return f"it is {format_span(back_s)} s before the sample above"
    how = "it has the same time as the sample above"
    same = int(np.count_nonzero(np.diff(t_s) == 0.0))
    if same >= MANY_SAME * len(t_s):
        how += (
            f", as {same} of {len(t_s)} samples; times were stored with too few digits: export "
            "them with all digits, or counted from the beginning"
        )
    return how


def format_span(span_s: float) -> str:
    """A time in s with the digits that matter, without an exponent."""
    return np.format_float_positional(span_s, precision=3, fractional=False, trim="-")
