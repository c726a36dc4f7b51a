"""Tables of a page as HTML; on a phone the rows of wide ones become cards.

`as_html` shows a `Table`, which is also written as CSV and LaTeX. `card_table` shows any cells,
also with drawings and links.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from itertools import groupby

from markupsafe import Markup

from rfca_rig.reports.elements import EMPTY, css_class, html, join
from rfca_rig.reports.table import (
    Foot,
    Table,
    TableCell,
    TableColumn,
    TableRow,
    cell,
    foot_cell,
    head_span,
)
from rfca_rig.reports.text import MINUS, NO_BREAK, NOTHING, in_thousands

# Width of a phone of 390 px in characters of a table, and of the gap between two columns.
PHONE_CHARACTERS = 50
GAP_CHARACTERS = 3
WORD_CHARACTERS = 14
# Longer texts of a cell are broken over lines.
MOST_UNBROKEN = 44
# Tables of more rows may be broken between two sheets of paper.
MOST_WHOLE_ROWS = 14
# A unit of its own column stands on the line of a short heading.
SHORT_HEADING = 7

# Classes of the style sheet: numbers, aligned right, and texts that are broken over lines.
NUMBER = "n"
WORDS = "words"
# A column with units, which a card shows behind the name of its row.
UNIT = "unit-column"


@dataclass(frozen=True)
class HtmlColumn:
    """Heading of a column. Its cells have the classes `css`.

    `card` is the heading of a cell on a card, by default the title, "" for none; `over` is common
    to neighbouring columns, and stands above their headings.
    """

    title: str
    css: str = ""
    card: str | None = None
    unit: str = ""
    over: str = ""


@dataclass(frozen=True)
class HtmlCell:
    """Content of a cell, text or Markup, with its classes; a card shows `unit` behind it."""

    content: str
    css: str = ""
    unit: str = ""


@dataclass(frozen=True)
class HtmlRow:
    """One row with the notes below it."""

    cells: tuple[HtmlCell, ...]
    is_marked: bool = False
    notes: tuple[str, ...] = ()


@dataclass(frozen=True)
class HtmlFoot:
    """A foot: `words` across `span` columns, then the other cells."""

    words: str
    span: int
    cells: tuple[HtmlCell, ...]


@dataclass(frozen=True)
class HtmlTable:
    """A table as a page shows it.

    Parameters
    ----------
    label
        Name for screen readers.
    columns
        Headings.
    groups
        Rows with the heading of their group, "" for none.
    foot
        Lines below the rows.
    caption
        Text above the table.
    css
        Classes of the style sheet.
    has_cards
        A phone shows each row as a card, as the columns do not fit beside each other.
    is_whole
        In print the table is not broken between two sheets.
    """

    label: str
    columns: tuple[HtmlColumn, ...]
    groups: tuple[tuple[str, tuple[HtmlRow, ...]], ...]
    foot: tuple[HtmlFoot, ...] = ()
    caption: str = ""
    css: str = ""
    has_cards: bool = True
    is_whole: bool = False


def as_html(shown: Table, css: str = "", label: str = "") -> Markup:
    """A table that is also a file; `label` tells tables of the same name apart."""
    return _render(cells_as_text(shown, css, label))


def card_table(
    label: str,
    columns: Sequence[HtmlColumn],
    rows: Iterable[Sequence[str | HtmlCell]],
    foot: Sequence[HtmlFoot] = (),
    css: str = "",
) -> Markup:
    """A table whose rows are cards on every phone. A cell that is a text has the classes of its
    column.
    """
    shown = []
    for row in rows:
        cells = []
        for column, content in zip(columns, row, strict=True):
            if isinstance(content, HtmlCell):
                cells.append(content)
            else:
                cells.append(HtmlCell(content, column.css))
        shown.append(HtmlRow(tuple(cells)))
    groups = (("", tuple(shown)),)
    return _render(HtmlTable(label, tuple(columns), groups, tuple(foot), css=css))


def cells_as_text(shown: Table, css: str = "", label: str = "") -> HtmlTable:
    """The table with every cell as text."""
    columns = tuple(_to_column(shown, column) for column in shown.shown)
    groups = []
    rows: list[HtmlRow] = []
    for name, table_rows in shown.groups():
        group_rows = tuple(_to_row(shown, row) for row in table_rows)
        groups.append((name, group_rows))
        rows += group_rows
    return HtmlTable(
        f"table {label or shown.name}",
        columns,
        tuple(groups),
        tuple(_to_foot(shown, foot) for foot in shown.foot),
        shown.caption,
        css,
        has_cards=not _fits_on_phone(columns, rows),
        is_whole=len(shown.rows) <= MOST_WHOLE_ROWS,
    )


def _to_column(shown: Table, column: TableColumn) -> HtmlColumn:
    unit = column.unit.replace(" ", NO_BREAK)
    card = column.title
    if column.over:
        card = f"{column.over}, {card}"
    if unit:
        card += f" ({unit})"
    css = ""
    if column.key in shown.numeric:
        css = NUMBER
    return HtmlColumn(column.title, css, card, unit, column.over)


def _fits_on_phone(columns: Sequence[HtmlColumn], rows: Sequence[HtmlRow]) -> bool:
    widths = []
    for index, column in enumerate(columns):
        heads = [len(word) for word in column.title.split()]
        cells = [_characters(row.cells[index]) for row in rows]
        widths.append(max([*heads, len(column.unit) + 2, *cells]))
    return sum(widths) + GAP_CHARACTERS * (len(widths) - 1) <= PHONE_CHARACTERS


def _characters(shown: HtmlCell) -> int:
    # Words are broken over lines, numbers are not.
    if shown.css == NUMBER:
        return len(shown.content)
    return min(len(shown.content), WORD_CHARACTERS)


def _to_row(shown: Table, row: TableRow) -> HtmlRow:
    cells = [_to_cell(shown, column, cell(column, row)) for column in shown.shown]
    units = [text for column, text in zip(shown.shown, cells, strict=True) if column.key == "unit"]
    # A card shows the unit behind the name of its row.
    if units and cells[0] is not units[0]:
        cells[0] = replace(cells[0], unit=units[0].content)
    return HtmlRow(tuple(cells), row.marked, tuple(shown.notes(row)))


def _to_foot(shown: Table, foot: Foot) -> HtmlFoot:
    span = head_span(shown, foot)
    cells = [_to_cell(shown, column, foot_cell(column, foot)) for column in shown.shown[span:]]
    return HtmlFoot(foot.words, span, tuple(cells))


def _to_cell(shown: Table, column: TableColumn, known: TableCell) -> HtmlCell:
    if known.is_number:
        text = in_thousands(known.text).replace("-", MINUS)
    else:
        text = known.text
    if known.half:
        text += f"{NO_BREAK}±{NO_BREAK}{known.half}"
    if column.key in shown.numeric:
        return HtmlCell(text or NOTHING, NUMBER)
    if len(text) > MOST_UNBROKEN:
        return HtmlCell(text, WORDS)
    if column.key == "unit":
        return HtmlCell(text, UNIT)
    return HtmlCell(text)


def _render(shown: HtmlTable) -> Markup:
    box_css = "wide"
    if shown.is_whole:
        box_css += " whole"
    table_css = shown.css
    if shown.has_cards:
        table_css = f"{shown.css} stack".strip()
    parts = [html("<thead>\n{}\n</thead>", _heads(shown.columns))]
    if shown.caption:
        parts.insert(0, html("<caption>{}</caption>", shown.caption))
    for name, rows in shown.groups:
        parts.append(html("<tbody>\n{}\n</tbody>", _group(shown, name, rows)))
    if shown.foot:
        lines = join("\n", [_foot(shown, foot) for foot in shown.foot])
        parts.append(html("<tfoot>\n{}\n</tfoot>", lines))
    return html(
        '<div class="{}" tabindex="0" role="region" aria-label="{}">\n<table{}>\n{}\n</table>\n'
        "</div>",
        box_css,
        shown.label,
        css_class(table_css),
        join("\n", parts),
    )


def _heads(columns: Sequence[HtmlColumn]) -> Markup:
    """The headings: one line, or two where neighbours have a heading in common."""
    if not any(column.over for column in columns):
        heads = [_head(column, column is columns[-1]) for column in columns]
        return html("<tr>{}</tr>", join("", heads))
    above: list[Markup] = []
    below: list[Markup] = []
    for over, neighbours in groupby(columns, lambda column: column.over):
        members = list(neighbours)
        if over:
            pattern = '<th scope="colgroup" class="over" colspan="{}">{}</th>'
            above.append(html(pattern, str(len(members)), over))
            below += [_head(column, column is columns[-1]) for column in members]
        else:
            above += [_head(column, column is columns[-1], lines=2) for column in members]
    return html("<tr>{}</tr>\n<tr>{}</tr>", join("", above), join("", below))


def _head(column: HtmlColumn, is_last: bool, lines: int = 1) -> Markup:
    span = EMPTY
    if lines > 1:
        span = html(' rowspan="{}"', str(lines))
    classes = []
    if NUMBER in column.css.split():
        classes.append(NUMBER)
    if is_last:
        classes.append("last")
    css = css_class(" ".join(classes))
    head = html('<th scope="col"{}{}>{}', span, css, column.title)
    if column.unit:
        gap = " "
        if len(column.title) < SHORT_HEADING:
            gap = NO_BREAK
        head += html('{}<span class="unit">({})</span>', gap, column.unit)
    return head + Markup("</th>")


def _group(shown: HtmlTable, name: str, rows: Sequence[HtmlRow]) -> Markup:
    width = str(len(shown.columns))
    lines = []
    if name:
        lines.append(html('<tr><th scope="rowgroup" colspan="{}">{}</th></tr>', width, name))
    for row in rows:
        css = css_class("marked" if row.is_marked else "")
        lines.append(html("<tr{}>{}</tr>", css, _cells(shown, shown.columns, row.cells)))
        for note in row.notes:
            lines.append(html('<tr class="note"><td colspan="{}">{}</td></tr>', width, note))
    return join("\n", lines)


def _foot(shown: HtmlTable, foot: HtmlFoot) -> Markup:
    cells = _cells(shown, shown.columns[foot.span :], foot.cells)
    pattern = '<tr><td class="words" colspan="{}">{}</td>{}</tr>'
    return html(pattern, str(foot.span), foot.words, cells)


def _cells(shown: HtmlTable, columns: Sequence[HtmlColumn], cells: Sequence[HtmlCell]) -> Markup:
    tags = []
    for column, content in zip(columns, cells, strict=True):
        attributes = css_class(content.css)
        head = column.title if column.card is None else column.card
        if shown.has_cards and head:
            attributes += html(' data-head="{}"', head)
        if shown.has_cards and content.unit:
            attributes += html(' data-unit="{}"', content.unit)
        tags.append(html("<td{}>{}</td>", attributes, content.content))
    return join("", tags)
