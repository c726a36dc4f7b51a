"""How a text file holds its table: what separates the cells, which sign is before the decimals, and
which lines are names, units and remarks.

Entry point: `detect_dialect`. Programs that write tables agree on none of this, and the file itself
shows all of it. Where it does not, the file is taken for the plain form: commas, a decimal point,
and names in the first line.
"""

import csv
import re
from collections.abc import Sequence
from dataclasses import dataclass

BLANKS = " "
# Any number of blanks is one separator, so it comes last: a name may hold a blank.
SEPARATORS = (",", ";", "\t", BLANKS)
IN_WORDS = {",": "commas", ";": "';'", "\t": "tabs", BLANKS: "blanks"}
# Lines in which the names are looked for: headers of loggers have 20 to 40.
HEADER_LINES = 100
# lines of numbers whose cells are counted
COUNTED_LINES = 30
_REMARK = re.compile(r"^\s*[#%]+\s*")

NUMBER = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?")
DECIMAL_COMMA = re.compile(r"[+-]?\d*,\d+([eE][+-]?\d+)?")
GROUPED = re.compile(r"[+-]?[1-9]\d{0,2}(,\d{3})+(\.\d*)?")
DATE_TIME = re.compile(r"\d{4}-\d\d-\d\d[T ]\d\d:\d\d(:\d\d([.,]\d+)?)?(Z|[+-]\d\d:?\d\d)?")
_NOT_A_VALUE = re.compile(r"[+-]?(nan|inf|infinity|n/a|na)", re.IGNORECASE)


@dataclass(frozen=True)
class Dialect:
    """The form of one table. Lines count from 0.

    Parameters
    ----------
    separator
        Between cells; BLANKS for any number of them.
    decimal
        The sign before the decimals, "." or ",".
    names
        Line of the names.
    units
        Line of the units; None where there is none.
    first
        First line of the data.
    """

    separator: str = ","
    decimal: str = "."
    names: int = 0
    units: int | None = None
    first: int = 1

    def split(self, line: str) -> tuple[str, ...]:
        """The cells of a line, as text without blanks around it; none of an empty line. Raises
        csv.Error.
        """
        return split_line(line, self.separator)


def split_line(line: str, separator: str) -> tuple[str, ...]:
    """The cells of a line, as text without blanks around it; none of an empty line. Raises
    csv.Error.
    """
    if separator == BLANKS:
        line = line.strip()
    reader = csv.reader([line], delimiter=separator, skipinitialspace=True)
    cells: list[str] = []
    for row in reader:
        cells = [cell.strip() for cell in row]
    # Loggers end a line with a tab.
    if separator == "\t" and cells and not cells[-1]:
        cells.pop()
    return tuple(cells)


def uncover_names(line: str) -> str:
    """A line of names without the sign for remarks that some programs write in front of it."""
    return _REMARK.sub("", line, count=1)


def with_point(cell: str, decimal: str) -> str:
    """A cell with a decimal point, whose file has the sign `decimal` before the decimals."""
    if decimal == ",":
        return cell.replace(",", ".")
    return cell


def detect_dialect(lines: Sequence[str]) -> Dialect:
    """The form of a table, from its first lines."""
    head = lines[:HEADER_LINES]
    best = Dialect()
    most = 0
    for separator in SEPARATORS:
        dialect = _try_separator(head, separator)
        if dialect is None:
            continue
        columns = len(split_line(lines[dialect.first], separator))
        # A tie goes to the earlier one: names may hold blanks, cells may be joined by commas.
        if columns > most:
            best = dialect
            most = columns
    return best


def _try_separator(head: Sequence[str], separator: str) -> Dialect | None:
    """The form of a table with this separator; None where its lines are no table with names."""
    try:
        cells = [split_line(uncover_names(line), separator) for line in head]
    except csv.Error:
        return None
    first = next((row for row in range(1, len(cells)) if _is_data(cells, row)), None)
    if first is None:
        return None
    above = first - 1
    while above >= 0 and not cells[above]:
        above -= 1
    if above < 0 or not _are_names(cells[above], len(cells[first])):
        return None
    names = above
    units = None
    # Of two lines of words the second holds units.
    if above > 0 and _are_names(cells[above - 1], len(cells[first])):
        names = above - 1
        units = above
    decimal = "."
    if separator != "," and _has_decimal_commas(cells[first:]):
        decimal = ","
    return Dialect(separator, decimal, names, units, first)


def _is_data(cells: Sequence[tuple[str, ...]], row: int) -> bool:
    """Whether a line, and those behind it, are data: as many cells, half of them values."""
    count = len(cells[row])
    if not count:
        return False
    for line in cells[row : row + COUNTED_LINES]:
        if len(line) != count:
            return False
    values = sum(map(is_value, cells[row]))
    return 2 * values >= count


def _are_names(line: tuple[str, ...], count: int) -> bool:
    """Whether a line can hold the names, or units, of `count` columns: none of them is a value."""
    if len(line) == count + 1 and line[-1].lower() in ("", "comment"):
        line = line[:-1]
    return len(line) == count and not any(map(is_value, line))


def is_value(cell: str) -> bool:
    """Whether a cell holds a number or a time, in any notation, or says that it has none."""
    forms = (NUMBER, DECIMAL_COMMA, GROUPED, DATE_TIME, _NOT_A_VALUE)
    return any(form.fullmatch(cell) for form in forms)


def _has_decimal_commas(data: Sequence[tuple[str, ...]]) -> bool:
    """Whether numbers have commas, and none has a point."""
    cells = [cell for line in data for cell in line]
    return any(map(DECIMAL_COMMA.fullmatch, cells)) and not any("." in cell for cell in cells)
