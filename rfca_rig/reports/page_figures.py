"""The figures of a page as SVG files of their own, for a paper or slides.

A page holds its figures as <svg> elements, whose colours and fonts come from the page's style
sheet. A file needs its own: the colours of light paper, and a serif font.
"""

import re
from collections.abc import Iterable
from pathlib import Path

from rfca_rig.escaping import html_text
from rfca_rig.reports.style import SOFT, colours
from rfca_rig.reports.table import write_all

FOLDER = "figures"
# Figures have a role and a name for screen readers; drawings of legends have not.
FIGURE = re.compile(
    r'<svg (?P<attributes>[^>]*role="img"[^>]*)>(?P<drawing>.*?)</svg>', flags=re.DOTALL
)
NAME = re.compile(r'aria-label="(?P<name>[^"]*)"')
VIEW = re.compile(r'viewBox="0 0 (?P<width>[\d.]+) (?P<height>[\d.]+)"')
# Areas over which a page shows values to a pointer.
HOVER = re.compile(r'<rect class="hover".*?</rect>', flags=re.DOTALL)
# A figure redrawn for a narrow screen, and the small drawings within a table.
NOT_ALONE = ('class="phone"', 'class="forest"')
# Characters of a file's name that come from the name of its figure.
NAME_LENGTH = 60
FONT = "Palatino, 'Palatino Linotype', 'URW Palladio L', P052, Georgia, serif"


def write_page_figures(pages: Iterable[Path]) -> list[Path]:
    """Writes every figure of the pages into the folder `figures` beside each page, named after the
    page. Figures of an earlier page of that name are removed.

    Raises RigError where a file cannot be written.
    """
    written = []
    for page in pages:
        folder = page.parent / FOLDER
        drawn = extract_figures(page.read_text("utf-8"))
        files = {f"{page.stem}-{name}.svg": svg for name, svg in drawn.items()}
        for earlier in folder.glob(f"{page.stem}-[0-9][0-9]-*.svg"):
            if earlier.name not in files:
                earlier.unlink()
        if files:
            write_all(folder, files)
        written += [folder / name for name in files]
    return written


def extract_figures(page: str) -> dict[str, str]:
    """SVG files by their names without the ending, in the order of the page."""
    figures: dict[str, str] = {}
    for match in FIGURE.finditer(page):
        attributes = match["attributes"]
        if any(css in attributes for css in NOT_ALONE):
            continue
        named = NAME.search(attributes)
        words = ""
        if named is not None:
            words = named["name"]
        slug = re.sub(r"[^a-z0-9]+", "-", words.lower()).strip("-")[:NAME_LENGTH].strip("-")
        name = f"{len(figures) + 1:02d}-{slug}".strip("-")
        figures[name] = _stand_alone(attributes, match["drawing"], words)
    return figures


def _stand_alone(attributes: str, drawing: str, words: str) -> str:
    """The drawing as a file; `words` are escaped already."""
    size = VIEW.search(attributes)
    view = ""
    if size is not None:
        view = f' {size[0]} width="{size["width"]}pt" height="{size["height"]}pt"'
    body = HOVER.sub("", drawing)
    for name, colour in {**colours(), "soft": SOFT}.items():
        body = body.replace(f"var(--{name})", colour)
    body = body.replace("currentColor", "#000000")
    return (
        '<?xml version="1.0" encoding="utf-8"?>\n'
        f'<svg xmlns="http://www.w3.org/2000/svg"{view} font-family="{html_text(FONT)}">\n'
        f"<title>{words}</title>\n{body}\n</svg>\n"
    )
