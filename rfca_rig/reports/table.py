"""Tables independent of their format: CSV for programs, LaTeX for a paper, HTML for a page,
plain text for a terminal.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import groupby
from math import isfinite
from pathlib import Path
from typing import Literal

from rfca_rig.errors import RigError
from rfca_rig.escaping import csv_line, printable
from rfca_rig.recording.atomic import write_atomically
from rfca_rig.reports.text import words_and_unit

Value = float | int | str | bool | None
Role = Literal["value", "kept", "group", "note"]

UNKNOWN_TEX = "--"

# Characters that LaTeX reads as commands, and characters beyond ASCII that the reports use.
SPECIAL = {
    "\\": r"\textbackslash{}",
    "~": r"\textasciitilde{}",
    "^": r"\textasciicircum{}",
    "<": r"\textless{}",
    ">": r"\textgreater{}",
    "|": r"\textbar{}",
    '"': "''",
    **{character: f"\\{character}" for character in "&%$#_{}"},
    "\u00a0": "~",
    "\u2212": "$-$",
    "\u2013": "--",
    "\u2019": "'",
    "\u201c": "``",
    "\u201d": "''",
    "\u2026": r"\ldots{}",
    "\u2192": r"$\to$",
    "±": r"$\pm$",
    "°": r"$^\circ$",
    "²": "$^2$",
    "³": "$^3$",
    "₀": "$_0$",
    "₂": "$_2$",
    "φ": r"$\varphi$",
    "\u03c3": r"$\sigma$",
    "χ": r"$\chi$",
    "·": r"$\cdot$",
}

# The paper's symbols for quantities of the reports.
SYMBOLS = {
    "|F|": "$|F|$",
    "fx": "$F_x$",
    "fy": "$F_y$",
    "fz": "$F_z$",
    "tx": "$T_x$",
    "k0": "$k_0$",
    "k2": "$k_2$",
}


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
        Key of the column with the uncertainty: one standard deviation or half an interval, as the
        table's caption states.
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
    """Values by the keys of the columns; missing ones and None are unknown. `digits` overrides that
    of the columns.

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
    """A table; `name` is that of its files. The `caption` states what is shown, over how many
    repeats, and the meaning of ±.
    """

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
        keys = set()
        for column in self.columns:
            if any(_is_number(row.values.get(column.key)) for row in self.rows):
                keys.add(column.key)
        return frozenset(keys)

    def groups(self) -> list[tuple[str, tuple[TableRow, ...]]]:
        """The rows by their group; without a name where there is only one."""
        # groupby joins neighbours only, so that rows keep their order.
        key = next((column.key for column in self.columns if column.role == "group"), "")
        groups = [
            (str(name), tuple(rows))
            for name, rows in groupby(self.rows, lambda row: row.values.get(key) or "")
        ]
        if len(groups) > 1:
            return groups
        return [("", self.rows)]

    def notes(self, row: TableRow) -> list[str]:
        """Notes below a row, a line each."""
        texts = (row.values.get(column.key) for column in self.columns if column.role == "note")
        return [str(text) for text in texts if text]

    def overs(self) -> list[tuple[str, int]]:
        """Headings above the columns with the number of columns each spans, "" where there is
        none; empty without any heading.
        """
        spans = [
            (over, len(list(columns)))
            for over, columns in groupby(self.shown, lambda column: column.over)
        ]
        if any(over for over, _ in spans):
            return spans
        return []


@dataclass(frozen=True)
class TableCell:
    """A value as text with an ASCII minus sign; `half` is the uncertainty after ±, "" for none.
    Both are "" for an unknown value.
    """

    text: str
    half: str = ""
    is_number: bool = False


def cell(column: TableColumn, row: TableRow) -> TableCell:
    """The value of a column in a row as text, with its uncertainty where there is one."""
    value = row.values.get(column.key)
    half = row.values.get(column.half) if column.half else None
    if value is None or (isinstance(value, float) and not isfinite(value)):
        return TableCell("")
    if isinstance(value, str):
        return TableCell(value)
    if isinstance(value, bool):
        return TableCell("yes" if value else "no")
    if column.set_value:
        return TableCell(f"{value:.6g}", is_number=True)
    if isinstance(half, int | float) and isfinite(half) and half > 0:
        known = float(half)
    else:
        known = None
    column_digits = row.digits
    if column_digits is None:
        column_digits = column.digits
    digits = _digits(value, known, column_digits)
    if known is None and 0.0 < value < 0.5 * 10.0**-digits:
        # Rounded to zero, a small value would look like none.
        return TableCell(f"< {format_rounded(10.0**-digits, digits)}", is_number=True)
    shown_half = ""
    if known is not None:
        shown_half = format_rounded(known, digits)
    return TableCell(format_rounded(value, digits), shown_half, is_number=True)


def foot_cell(column: TableColumn, foot: Foot) -> TableCell:
    """The value of a column in a foot as text."""
    return cell(column, TableRow(foot.values, foot.digits))


def head_span(table: Table, foot: Foot) -> int:
    """Number of shown columns before the first value of a foot, which its words may span."""
    return next(
        (index for index, column in enumerate(table.shown) if column.key in foot.values),
        len(table.shown),
    )


def format_rounded(value: float, digits: int) -> str:
    """A value with `digits` decimals, negative ones for tens and hundreds; no minus where all
    digits shown are zero.
    """
    # Adding 0.0 turns the -0.0 that rounding leaves into 0.0.
    return f"{round(value, digits) + 0.0:.{max(digits, 0)}f}"


def _digits(value: float, half: float | None, asked: int | None) -> int:
    if asked is not None:
        return asked
    if isinstance(value, int):
        return 0
    if half is not None:
        return places(half, 2)
    return places(value, 4)


def places(size: float, digits: int) -> int:
    """Decimals that show `size` with so many digits; negative where it is rounded to tens or
    hundreds.
    """
    if not size or not isfinite(size):
        return digits - 1
    # The exponent of the formatted text, which is rounded to seven digits first: 999.99999999
    # counts as 1000.
    exponent = int(f"{abs(size):e}".partition("e")[2])
    return digits - 1 - exponent


def _is_number(value: Value) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)


def with_common_decimals(column: TableColumn, rows: Sequence[TableRow]) -> TableColumn:
    """The column with the same decimals in all rows, as many as show two digits of the median
    uncertainty.
    """
    halves = [row.values.get(column.half) for row in rows]
    known = sorted(
        float(half)
        for half in halves
        if isinstance(half, int | float) and isfinite(half) and half > 0
    )
    if known:
        return replace(column, digits=max(places(known[len(known) // 2], 2), 0))
    return column


def tex_head(text: str) -> str:
    """Heading of a column in LaTeX, with the paper's symbols for its quantities."""
    return " ".join(SYMBOLS.get(word, tex_text(word)) for word in text.split(" "))


def tex_text(text: str) -> str:
    """Any text with LaTeX's special characters escaped; letters with accents are left to the
    document's encoding.
    """
    return "".join(
        SPECIAL.get(character, character if character.isprintable() else " ") for character in text
    )


def tex_unit(unit: str) -> str:
    """A unit in LaTeX: N m/rad with thin spaces, N/m^1.5 with an exponent."""
    base, _, power = unit.partition("^")
    text = tex_text(base).replace(" ", r"\,")
    if power:
        return f"{text}$^{{{power}}}$"
    return text


def tex_number(text: str, half: str = "") -> str:
    r"""A number in math mode, which sets a proper minus sign; with $\pm$ where there is an
    uncertainty.
    """
    if half:
        return rf"${text} \pm {half}$"
    return f"${text}$"


def as_csv(table: Table) -> str:
    """The table as CSV: every column under its key, numbers with up to twelve digits, unknown
    values empty.
    """
    lines = [csv_line(column.key for column in table.columns)]
    for row in table.rows:
        lines.append(csv_line(_plain(row.values.get(column.key)) for column in table.columns))
    return "".join(lines)


def _plain(value: Value) -> Value:
    """Numbers with twelve digits: more than any measurement has, and few enough that rounding
    errors of machines do not show.
    """
    if isinstance(value, bool):
        if value:
            return "yes"
        return "no"
    if not isinstance(value, float):
        return value
    if not isfinite(value):
        return ""
    # Adding zero turns -0.0 into 0.0.
    return float(f"{value:.12g}") + 0.0


def as_tex(table: Table) -> str:
    """The table as a LaTeX tabular for a document that loads booktabs; the caption is in a
    comment above it.
    """
    alignment = "".join("r" if column.key in table.numeric else "l" for column in table.shown)
    if any(column.upright for column in table.shown):
        packages = "booktabs,graphicx"
    else:
        packages = "booktabs"
    lines = [
        rf"% needs \usepackage{{{packages}}}; {printable(' '.join(table.caption.split()))}",
        rf"\begin{{tabular}}{{{alignment}}}",
        r"\toprule",
    ]
    lines += _tex_heads(table)
    for name, rows in table.groups():
        lines.append(r"\midrule")
        if name:
            lines.append(rf"\multicolumn{{{len(alignment)}}}{{l}}{{{tex_text(name)}}} \\")
        for row in rows:
            lines.append(
                _tex_line(
                    [
                        _tex_cell(column, cell(column, row), column.key in table.numeric)
                        for column in table.shown
                    ]
                )
            )
            lines += [
                rf"\multicolumn{{{len(alignment)}}}{{l}}{{\quad {tex_text(note)}}} \\"
                for note in table.notes(row)
            ]
    if table.foot:
        lines.append(r"\midrule")
        lines += [_tex_foot(table, foot) for foot in table.foot]
    return "\n".join([*lines, r"\bottomrule", r"\end{tabular}"]) + "\n"


def _tex_heads(table: Table) -> list[str]:
    heads = _tex_line([_tex_head(column, column.key in table.numeric) for column in table.shown])
    overs = table.overs()
    if not overs:
        return [heads]
    above = []
    rules = []
    at = 1
    for over, span in overs:
        if over:
            above.append(rf"\multicolumn{{{span}}}{{c}}{{{tex_text(over)}}}")
            rules.append(rf"\cmidrule(lr){{{at}-{at + span - 1}}}")
        else:
            above.append(" & ".join([""] * span))
        at += span
    return [_tex_line(above), "".join(rules), heads]


def _tex_head(column: TableColumn, is_number: bool) -> str:
    text = tex_head(column.title)
    if column.unit:
        text += f" ({tex_unit(column.unit)})"
    if column.upright:
        return rf"\rotatebox{{90}}{{{text}~}}"
    if is_number:
        return rf"\multicolumn{{1}}{{r}}{{{text}}}"
    return text


def _tex_foot(table: Table, foot: Foot) -> str:
    span = head_span(table, foot)
    cells = [
        _tex_cell(column, foot_cell(column, foot), column.key in table.numeric)
        for column in table.shown[span:]
    ]
    return _tex_line([rf"\multicolumn{{{span}}}{{l}}{{{tex_text(foot.words)}}}", *cells])


def _tex_line(cells: Sequence[str]) -> str:
    return " & ".join(cells) + r" \\"


def _tex_cell(column: TableColumn, cell: TableCell, is_number: bool) -> str:
    if not cell.text:
        # An upright table is a matrix of counts, where an empty cell means none.
        if is_number and not column.upright:
            return UNKNOWN_TEX
        return ""
    if column.key == "unit":
        return tex_unit(cell.text)
    if cell.is_number:
        return tex_number(cell.text, cell.half)
    return tex_head(cell.text)


def as_text(table: Table) -> str:
    """The table as aligned columns of ASCII for a terminal, without feet and notes."""
    lines = [
        [_head_text(column) for column in table.shown],
        *(row_texts(table, row) for row in table.rows),
    ]
    widths = [max(map(len, texts)) for texts in zip(*lines, strict=True)]
    return "".join(f"{_align(table, line, widths)}\n" for line in lines)


def row_texts(table: Table, row: TableRow) -> list[str]:
    """The shown cells of a row as ASCII text."""
    return [_text(cell(column, row)) for column in table.shown]


def _align(table: Table, line: Sequence[str], widths: Sequence[int]) -> str:
    placed = zip(line, widths, table.shown, strict=True)
    return "  ".join(
        text.rjust(width) if column.key in table.numeric else text.ljust(width)
        for text, width, column in placed
    ).rstrip()


def _head_text(column: TableColumn) -> str:
    over = f"{column.over}: " if column.over else ""
    if column.unit:
        return f"{over}{column.title} ({column.unit})"
    return f"{over}{column.title}"


def _text(cell: TableCell) -> str:
    if cell.half:
        return f"{cell.text} +- {cell.half}"
    return cell.text


def write_all(out: Path, contents: Mapping[str, str]) -> None:
    """Writes texts by their file names; `out` is made where it does not exist. Raises RigError
    where a file cannot be written.
    """
    try:
        out.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise RigError(
            f"{out}: the folder for the report cannot be made: {error.strerror}; give "
            "another with --out"
        ) from None
    for name, text in contents.items():
        write_atomically(out / name, text.encode("utf-8"))


def table_files(tables: Iterable[Table]) -> dict[str, str]:
    """CSV and LaTeX of each table, by file name.

    A table without rows is written too: otherwise the file of an earlier report would remain beside
    the page.
    """
    pairs = (
        ((f"{table.name}.csv", as_csv(table)), (f"{table.name}.tex", as_tex(table)))
        for table in tables
    )
    return {name: text for pair in pairs for name, text in pair}
