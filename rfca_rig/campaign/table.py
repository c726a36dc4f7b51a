"""A CSV file and its cells as numbers. Clean files take a fast path; a slow path only searches
the fault to report.
"""

import csv
import math
import re
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Protocol, TypeVar

import numpy as np
from numpy.typing import NDArray

from rfca_rig.campaign.recorded_columns import finite_or_none
from rfca_rig.errors import BadInput
from rfca_rig.executors.reading import (
    BYTES_PER_GIB,
    MEMORY_VARIABLE,
    read_within_limits,
    reading_limits,
)
from rfca_rig.toml import read_text

Floats = NDArray[np.float64]
Result = TypeVar("Result")

# Of one recording; fewer are refused.
FEWEST_SAMPLES = 10

_NUMBER = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?")
# Typical faults, each with a message of its own.
_DECIMAL_COMMA = re.compile(r"[+-]?\d+,\d+([eE][+-]?\d+)?")
_NOT_A_VALUE = re.compile(r"[+-]?(nan|inf|infinity|n/a|na|#.*)", re.IGNORECASE)
# Bytes of memory for each byte of a table, while its text is split into lines and cells.
MEMORY_PER_BYTE = 8
# A table below takes less than a second, whatever it holds.
SMALL_BYTES = 4_000_000
_SEPARATORS = {";": "';'", "\t": "tabs"}


@dataclass(frozen=True)
class CsvTable:
    """A comma-separated file: the names in its first line, and the other lines unparsed. Data
    line i is line i + 2 of the file.
    """

    path: Path
    names: tuple[str, ...]
    lines: tuple[str, ...]

    def fault(self, row: int, problem: str) -> BadInput:
        """The error for data line `row`, from 0."""
        return BadInput(f"{self.path}:{row + 2}: {problem}")


def read_table(path: Path) -> CsvTable:
    """Read the file's header and lines. Raises BadInput for a file that is missing, empty, not
    UTF-8 or not comma-separated.
    """
    # Line ends of every operating system.
    most_bytes = int(reading_limits().memory_GiB * BYTES_PER_GIB / MEMORY_PER_BYTE)
    lines = (
        read_text(path, most_bytes, f"raise {MEMORY_VARIABLE}, or split it")
        .replace("\r\n", "\n")
        .replace("\r", "\n")
        .split("\n")
    )
    while lines and not lines[-1].strip():
        lines.pop()
    if not lines:
        raise BadInput(f"{path}: is empty; it needs a line of column names and a line per sample")
    names = _names(path, lines[0])
    if len(lines) == 1:
        raise BadInput(f"{path}:1: holds column names and no data")
    return CsvTable(path, names, tuple(lines[1:]))


def _names(path: Path, header: str) -> tuple[str, ...]:
    for separator, shown in _SEPARATORS.items():
        # Names may contain single separators of another kind, so counts are compared.
        if header.count(separator) > header.count(","):
            raise BadInput(
                f"{path}:1: columns are separated by {shown}; export it again with commas "
                "between columns and a decimal point in numbers"
            )
    return _cells(path, 1, header)


def _cells(path: Path, number: int, line: str) -> tuple[str, ...]:
    """The cells of a line, as text without blanks around it; none of an empty line."""
    try:
        return tuple(cell.strip() for cell in next(csv.reader([line], skipinitialspace=True), ()))
    except csv.Error as error:
        raise BadInput(f"{path}:{number}: is no line of comma-separated numbers: {error}") from None


def numbers(table: CsvTable) -> Floats:
    """All cells (rows, columns) as finite numbers. Raises BadInput naming line and column of the
    first fault.
    """
    return _numbers_at(table, range(len(table.names)))


def columns(table: CsvTable, names: Sequence[str]) -> Floats:
    """These columns (rows, k) as finite numbers, whatever the others hold. Raises ValueError for
    an unknown name.
    """
    return _numbers_at(table, [table.names.index(name) for name in names])


def _numbers_at(table: CsvTable, places: Sequence[int]) -> Floats:
    return _read_bounded(table, partial(_numbers_in, table, places))


def _read_bounded(table: CsvTable, read: Callable[[], Result]) -> Result:
    """What `read` makes of a table, within the limits of time and memory where it is large
    enough to reach them.
    """
    is_small = sum(map(len, table.lines)) < SMALL_BYTES
    if is_small:
        return read()
    return read_within_limits(table.path, read)


def _numbers_in(table: CsvTable, places: Sequence[int]) -> Floats:
    values = _fast(table)
    if values is None or not np.isfinite(values[:, places]).all():
        numbers = []
        for row, cells in enumerate(rows(table)):
            numbers.append([number(table, row, table.names[i], cells[i]) for i in places])
        return np.array(numbers)
    return np.ascontiguousarray(values[:, places])


def numeric_columns(table: CsvTable) -> dict[str, Floats | None]:
    """Every column (rows,) by its name, None where not all cells are finite numbers. Raises
    BadInput as `rows` does.
    """
    return _read_bounded(table, partial(_numeric_columns_in, table))


def _numeric_columns_in(table: CsvTable) -> dict[str, Floats | None]:
    values = _fast(table)
    if values is not None:
        columns = zip(table.names, values.T, strict=True)
        return {name: finite_or_none(column) for name, column in columns}
    cells = dict(zip(table.names, zip(*rows(table), strict=True), strict=True))
    return {
        name: None if any(map(_fault_in_number, column)) else np.array(column, dtype=float)
        for name, column in cells.items()
    }


def _fast(table: CsvTable) -> Floats | None:
    """All cells (rows, columns), None where some are not numbers or a line has another number of
    cells.
    """
    try:
        # loadtxt would otherwise drop the rest of a line after "#", and a fault with it.
        values = np.loadtxt(
            table.lines, delimiter=",", dtype=np.float64, comments=None, quotechar='"', ndmin=2
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
    if fault := _fault_in_number(cell):
        raise table.fault(row, f"column {name}: {fault}")
    return float(cell)


def rows(table: CsvTable) -> Iterator[tuple[str, ...]]:
    """The cells of each data line, as text without surrounding blanks. Raises BadInput for a
    line with another number of cells.
    """
    for row, line in enumerate(table.lines):
        cells = _cells(table.path, row + 2, line)
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
    if _DECIMAL_COMMA.fullmatch(cell):
        return f"{cell} has a decimal comma; export the file again with a decimal point"
    if _NOT_A_VALUE.fullmatch(cell):
        return f"{cell} is not a value; every cell needs a finite number"
    if not _NUMBER.fullmatch(cell):
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
        raise recording.fault(
            row, f"time does not run forwards: {t_s[row]:g} s after {t_s[row - 1]:g} s"
        )
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
