"""Builds a page from its sections: the head and the foot that all pages have in common, and the
style sheets, which are in this package.
"""

from collections.abc import Sequence
from functools import cache
from importlib import resources

from jinja2 import Environment, FunctionLoader, StrictUndefined
from markupsafe import Markup

from rfca_rig.escaping import printable
from rfca_rig.reports import elements
from rfca_rig.reports.elements import EMPTY
from rfca_rig.reports.provenance import Origin
from rfca_rig.reports.sections import Sections, list_contents, render_sections
from rfca_rig.reports.style import DARK, colours
from rfca_rig.reports.text import MARK_MEANINGS


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
    return (
        _environment()
        .get_template("base.html")
        .render(
            title=title,
            opening=opening,
            sections=sections,
            origin=origin,
            files=files,
            sheets=sheets,
            closing=closing,
            is_always_light=is_always_light,
        )
    )


@cache
def _environment() -> Environment:
    """Environment of head and foot, with colours, meanings of the marks and elements of a page."""
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
    environment.globals |= {
        "beside": beside,
        "palette": colours(),
        "dark_palette": DARK,
        "mark_meanings": MARK_MEANINGS,
        "elements": elements,
        "list_contents": list_contents,
        "render_sections": render_sections,
    }
    return environment


def beside(name: str) -> str:
    """Text of a template or style sheet of this package."""
    return resources.files("rfca_rig.reports").joinpath(name).read_text("utf-8")
