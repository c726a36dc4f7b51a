"""Sections of a page. A page is a list of them, which `templates.render_page` builds into one
file.
"""

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from markupsafe import Markup

from rfca_rig.reports.elements import EMPTY, division, html, join


@dataclass(frozen=True)
class PageSection:
    """A heading, "" for none, and the contents below it, from `elements` and `html_table`.

    The list at the head of the page names sections of level 2. Those of level 3 belong to the one
    before.
    """

    title: str
    contents: Sequence[Markup]
    level: int = 2


@dataclass(frozen=True)
class SideBySide:
    """Columns of sections, beside each other where the screen is wide enough; the class `css` of
    the style sheet lays them out.
    """

    css: str
    columns: Sequence["Sections"]


# A function that makes a section returns None where there is nothing to show.
Sections = Sequence[PageSection | SideBySide | None]


def list_contents(sections: Sections) -> list[tuple[str, str]]:
    """Anchor and title of each section of level 2."""
    flat = _flatten(sections)
    return [(_anchor(section), section.title) for section in flat if _is_listed(section)]


def render_sections(sections: Sections) -> Markup:
    """All sections as HTML, in their order."""
    parts = []
    for entry in sections:
        if isinstance(entry, SideBySide):
            columns = [
                html("<section>\n{}\n</section>", render_sections(column))
                for column in entry.columns
            ]
            parts.append(division(entry.css, *columns))
        elif entry is not None:
            parts.append(_render(entry))
    return join("\n", parts)


def _flatten(sections: Sections) -> Iterator[PageSection]:
    for entry in sections:
        if isinstance(entry, SideBySide):
            for column in entry.columns:
                yield from _flatten(column)
        elif entry is not None:
            yield entry


def _render(section: PageSection) -> Markup:
    return join("\n", [_heading(section), *section.contents])


def _heading(section: PageSection) -> Markup:
    if not section.title:
        return EMPTY
    if _is_listed(section):
        return html('<h2 id="{}">{}</h2>', _anchor(section), section.title)
    return html("<h3>{}</h3>", section.title)


def _is_listed(section: PageSection) -> bool:
    return section.level == 2 and bool(section.title)


def _anchor(section: PageSection) -> str:
    return re.sub(r"\W+", "-", section.title.lower()).strip("-")
