"""Loads the templates and style sheets of the pages, which are in this package."""

import re
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from html import unescape
from importlib import resources

from jinja2 import Environment, FunctionLoader, StrictUndefined, Template
from markupsafe import Markup

from rfca_rig import __version__
from rfca_rig.escaping import printable
from rfca_rig.reports import elements
from rfca_rig.reports.elements import EMPTY
from rfca_rig.reports.provenance import Origin
from rfca_rig.reports.sections import Sections, list_contents, render_sections
from rfca_rig.reports.style import DARK, colours
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
from rfca_rig.reports.text import MARK_MEANINGS, MINUS, NO_BREAK, NOTHING, in_thousands

# Width of a phone of 390 px in characters of a table, and of the gap between two columns.
PHONE_CHARACTERS = 50
GAP_CHARACTERS = 3
WORD_CHARACTERS = 14
# Longer texts of a cell are broken over lines.
MOST_UNBROKEN = 44

HEADING = re.compile(r"<h2>(.*?)</h2>", re.DOTALL)


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
    """Content for the macro `table` in parts.html; `stacked` are the headings where cells stand
    below each other.

    `unit_place` is the column with units, which a phone shows behind the row's name.
    """

    heads: tuple[ShownCell, ...]
    stacked: tuple[str, ...]
    unit_place: int | None
    units: tuple[str, ...]
    overs: tuple[tuple[str, int], ...]
    groups: tuple[tuple[str, tuple[ShownRow, ...]], ...]
    foot: tuple[ShownFoot, ...]

    @property
    def is_wide(self) -> bool:
        """True where a phone shows each row as a card, as the columns do not fit beside each
        other.
        """
        rows = [row.cells for _, rows in self.groups for row in rows]
        widths = [
            max(
                [
                    *map(len, head.text.split()),
                    len(unit) + 2,
                    *(_characters(row[index]) for row in rows),
                ]
            )
            for index, (head, unit) in enumerate(zip(self.heads, self.units, strict=True))
        ]
        return sum(widths) + GAP_CHARACTERS * (len(widths) - 1) > PHONE_CHARACTERS


def cells_as_text(table: Table) -> ShownTable:
    """The table with every cell as text."""
    return ShownTable(
        heads=tuple(ShownCell(column.title, column.key in table.numeric) for column in table.shown),
        stacked=tuple(_card_head(column) for column in table.shown),
        unit_place=next(
            (index for index, column in enumerate(table.shown) if column.key == "unit"), None
        ),
        units=tuple(column.unit.replace(" ", NO_BREAK) for column in table.shown),
        overs=tuple(table.overs()),
        groups=tuple(
            (name, tuple(_row(table, row) for row in rows)) for name, rows in table.groups()
        ),
        foot=tuple(_foot(table, foot) for foot in table.foot),
    )


def _card_head(column: TableColumn) -> str:
    over = f"{column.over}, " if column.over else ""
    if column.unit:
        return f"{over}{column.title} ({column.unit.replace(' ', NO_BREAK)})"
    return f"{over}{column.title}"


def _characters(cell: ShownCell) -> int:
    # Words are broken over lines, numbers are not.
    if cell.right:
        return len(cell.text)
    return min(len(cell.text), WORD_CHARACTERS)


def _row(table: Table, row: TableRow) -> ShownRow:
    cells = tuple(_to_cell(table, column, cell(column, row)) for column in table.shown)
    return ShownRow(cells, row.marked, tuple(table.notes(row)))


def _foot(table: Table, foot: Foot) -> ShownFoot:
    span = head_span(table, foot)
    cells = tuple(_to_cell(table, column, foot_cell(column, foot)) for column in table.shown[span:])
    return ShownFoot(foot.words, span, cells)


def _to_cell(table: Table, column: TableColumn, cell: TableCell) -> ShownCell:
    if cell.is_number:
        text = in_thousands(cell.text).replace("-", MINUS)
    else:
        text = cell.text
    if cell.half:
        text += f"{NO_BREAK}±{NO_BREAK}{cell.half}"
    return ShownCell(
        text or (NOTHING if column.key in table.numeric else ""), column.key in table.numeric
    )


def render_page(
    title: str,
    opening: Markup,
    sections: Sections,
    origin: Origin,
    files: Sequence[str] = (),
    sheets: Sequence[str] = (),
    closing: Markup = EMPTY,
    is_always_light: bool = False,
) -> str:
    """A page as HTML.

    Parameters
    ----------
    title
        Title of the window.
    opening
        What a reader sees first, above the facts of the recordings and the list of contents.
    sections
        Contents in the order of the page.
    origin
        Where the page comes from, for its head and foot.
    files
        Names of the files beside the page, which its foot links.
    sheets
        Style sheets of this package, after the one of all pages.
    closing
        Begin of the foot, as settings.
    is_always_light
        The page stays light where the reader's system is dark.
    """
    return template("page.html").render(
        title=title,
        opening=opening,
        sections=sections,
        origin=origin,
        files=files,
        sheets=sheets,
        closing=closing,
        is_always_light=is_always_light,
    )


def template(name: str) -> Template:
    """A template that escapes the values it is given, and fails on a missing one."""
    return _environment().get_template(name)


@cache
def _environment() -> Environment:
    """Environment of all templates, with colours, meanings of the marks, version and the
    filters.
    """
    # StrictUndefined: a misspelt name fails in tests instead of leaving a gap in a page.
    environment = Environment(
        loader=FunctionLoader(beside),
        autoescape=True,
        # Texts of a page; what a template calls safe was escaped by who made it.
        finalize=lambda value: printable(value) if type(value) is str else value,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters["words"] = lambda id_: id_.replace("_", " ")
    environment.filters["with_anchors"] = with_anchors
    environment.filters["contents"] = contents
    environment.globals |= {
        "beside": beside,
        "palette": colours(),
        "dark_palette": DARK,
        # By name, so that keys follow the page into dark mode.
        "colours": {name: f"var(--{name})" for name in colours()},
        "mark_meanings": MARK_MEANINGS,
        "shown_cells": cells_as_text,
        "most_unbroken": MOST_UNBROKEN,
        "version": __version__,
        "elements": elements,
        "list_contents": list_contents,
        "render_sections": render_sections,
    }
    return environment


def contents(body: str) -> list[tuple[str, str]]:
    """Anchor and text of each second-level heading of a page's body, in their order."""
    titles = [re.sub(r"<[^>]*>", "", title) for title in HEADING.findall(body)]
    return [(re.sub(r"\W+", "-", unescape(title).lower()).strip("-"), title) for title in titles]


def with_anchors(body: str) -> str:
    """The body with an id on every second-level heading, for the list of contents."""
    anchors = iter(contents(body))
    return HEADING.sub(lambda match: f'<h2 id="{next(anchors)[0]}">{match[1]}</h2>', body)


def beside(name: str) -> str:
    """Text of a template or style sheet of this package."""
    return resources.files("rfca_rig.reports").joinpath(name).read_text("utf-8")
