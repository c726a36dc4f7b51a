"""Tables as files: CSV with all columns for programs, LaTeX with booktabs for papers, plain text for terminals."""

import csv
import io
from collections.abc import Sequence
from math import isfinite

from rfca_rig.report.table import Foot, Table, TableCell, TableColumn, TableRow, Value, cell, foot_cell, head_span

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
SYMBOLS = {"|F|": "$|F|$", "fx": "$F_x$", "fy": "$F_y$", "fz": "$F_z$", "tx": "$T_x$", "k0": "$k_0$", "k2": "$k_2$"}


def tex_head(text: str) -> str:
    """Heading of a column in LaTeX, with the paper's symbols for its quantities."""
    return " ".join(SYMBOLS.get(word, tex_text(word)) for word in text.split(" "))


def tex_text(text: str) -> str:
    """Any text with LaTeX's special characters escaped; letters with accents are left to the document's encoding."""
    return "".join(SPECIAL.get(character, character) for character in text)


def tex_unit(unit: str) -> str:
    """A unit in LaTeX: N m/rad with thin spaces, N/m^1.5 with an exponent."""
    base, _, power = unit.partition("^")
    text = tex_text(base).replace(" ", r"\,")
    return f"{text}$^{{{power}}}$" if power else text


def tex_number(text: str, half: str = "") -> str:
    r"""A number in math mode, which sets a proper minus sign; with $\pm$ where there is an uncertainty."""
    return rf"${text} \pm {half}$" if half else f"${text}$"


def as_csv(table: Table) -> str:
    """The table as CSV: every column under its key, numbers with up to twelve digits, unknown values empty."""
    # The same line ends on every system, so that files have the same bytes.
    out = io.StringIO()
    writer = csv.writer(out, lineterminator="\n")
    writer.writerow([column.key for column in table.columns])
    writer.writerows([_plain(row.values.get(column.key)) for column in table.columns] for row in table.rows)
    return out.getvalue()


def _plain(value: Value) -> Value:
    """Numbers with twelve digits: more than any measurement has, and few enough that rounding errors of machines do not show."""
    if isinstance(value, bool):
        return "yes" if value else "no"
    return (float(f"{value:.12g}") + 0.0 if isfinite(value) else "") if isinstance(value, float) else value


def as_tex(table: Table) -> str:
    """The table as a LaTeX tabular for a document that loads booktabs; the caption is in a comment above it."""
    alignment = "".join("r" if column.key in table.numeric else "l" for column in table.shown)
    packages = "booktabs,graphicx" if any(column.upright for column in table.shown) else "booktabs"
    lines = [rf"% needs \usepackage{{{packages}}}; {' '.join(table.caption.split())}", rf"\begin{{tabular}}{{{alignment}}}", r"\toprule"]
    lines += _tex_heads(table)
    for name, rows in table.groups():
        lines.append(r"\midrule")
        lines += [rf"\multicolumn{{{len(alignment)}}}{{l}}{{{tex_text(name)}}} \\"] if name else []
        for row in rows:
            lines.append(_tex_line([_tex_cell(column, cell(column, row), column.key in table.numeric) for column in table.shown]))
            lines += [rf"\multicolumn{{{len(alignment)}}}{{l}}{{\quad {tex_text(note)}}} \\" for note in table.notes(row)]
    lines += [r"\midrule", *(_tex_foot(table, foot) for foot in table.foot)] if table.foot else []
    return "\n".join([*lines, r"\bottomrule", r"\end{tabular}"]) + "\n"


def _tex_heads(table: Table) -> list[str]:
    heads = _tex_line([_tex_head(column, column.key in table.numeric) for column in table.shown])
    overs = table.overs()
    if not overs:
        return [heads]
    above = [rf"\multicolumn{{{span}}}{{c}}{{{tex_text(over)}}}" if over else " & ".join([""] * span) for over, span in overs]
    rules, at = [], 1
    for over, span in overs:
        rules += [rf"\cmidrule(lr){{{at}-{at + span - 1}}}"] if over else []
        at += span
    return [_tex_line(above), "".join(rules), heads]


def _tex_head(column: TableColumn, is_number: bool) -> str:
    unit = f" ({tex_unit(column.unit)})" if column.unit else ""
    text = f"{tex_head(column.title)}{unit}"
    if column.upright:
        return rf"\rotatebox{{90}}{{{text}~}}"
    return rf"\multicolumn{{1}}{{r}}{{{text}}}" if is_number else text


def _tex_foot(table: Table, foot: Foot) -> str:
    span = head_span(table, foot)
    cells = [_tex_cell(column, foot_cell(column, foot), column.key in table.numeric) for column in table.shown[span:]]
    return _tex_line([rf"\multicolumn{{{span}}}{{l}}{{{tex_text(foot.words)}}}", *cells])


def _tex_line(cells: Sequence[str]) -> str:
    return " & ".join(cells) + r" \\"


def _tex_cell(column: TableColumn, found: TableCell, is_number: bool) -> str:
    if not found.text:
        # An upright table is a matrix of counts, where an empty cell means none.
        return UNKNOWN_TEX if is_number and not column.upright else ""
    if column.key == "unit":
        return tex_unit(found.text)
    return tex_number(found.text, found.half) if found.is_number else tex_head(found.text)


def as_text(table: Table) -> str:
    """The table as aligned columns of ASCII for a terminal, without feet and notes."""
    lines = [[_head_text(column) for column in table.shown], *(row_texts(table, row) for row in table.rows)]
    widths = [max(len(line[place]) for line in lines) for place in range(len(table.shown))]
    return "".join(f"{_align(table, line, widths)}\n" for line in lines)


def row_texts(table: Table, row: TableRow) -> list[str]:
    """The shown cells of a row as ASCII text."""
    return [_text(cell(column, row)) for column in table.shown]


def _align(table: Table, line: Sequence[str], widths: Sequence[int]) -> str:
    placed = zip(line, widths, table.shown, strict=True)
    return "  ".join(text.rjust(width) if column.key in table.numeric else text.ljust(width) for text, width, column in placed).rstrip()


def _head_text(column: TableColumn) -> str:
    over = f"{column.over}: " if column.over else ""
    return f"{over}{column.title} ({column.unit})" if column.unit else f"{over}{column.title}"


def _text(found: TableCell) -> str:
    return f"{found.text} +- {found.half}" if found.half else found.text
