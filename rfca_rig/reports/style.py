"""Common style of all figures: colours with one meaning everywhere, line widths, font sizes.

Measured is a dark thin line over simulated, a broad lighter one. The two differ in greyscale and for every kind of colour vision. Both have
a contrast of at least 3 : 1 to the paper and to each other (WCAG 2, graphics), and both remain visible where they coincide.

Also small multiples on one scale, decimation of lines, inline SVG without ids that two figures could share, and pictures as files.
"""

import io
import re
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from itertools import pairwise
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.text import Text
from numpy.typing import NDArray

from rfca_rig.errors import BadInput
from rfca_rig.recording.atomic import write_atomically

MEASURED = "#173f6b"
SIMULATED = "#d07f0e"
SIMULATED_EDGE = "#7a4500"
# The model before a fit, or another form of a law; always dashed as well.
OTHER = "#9a3a6a"
# Failed, false, beyond a limit.
BAD = "#b34a00"
ALIKE = "#8fa9c6"
PALE = "#e4e0d8"
FAINT = "#8a8a8a"
PAPER = "#fffefb"

STYLE: dict[Any, Any] = {
    "font.size": 9.2,
    "axes.linewidth": 0.6,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "xtick.major.width": 0.6,
    "ytick.major.width": 0.6,
    "xtick.major.size": 3.0,
    "ytick.major.size": 3.0,
    # Lines are decimated by `envelope`, which keeps every peak; no further point may be dropped.
    "path.simplify": False,
}
SMALL = 8.2

FORMATS = (".svg", ".png", ".pdf")

Floats = NDArray[np.float64]

# Sizes in inches of the whole figure, a panel, and the margins for labels and titles.
WIDTH_IN = 8.6
PANEL_IN = 1.3
LEFT_IN, BOTTOM_IN, TOP_IN, GAP_IN = 0.62, 0.5, 0.26, 0.28

# Paths of 400 characters or more; on shorter ones little is saved.
LINE = re.compile(r' d="(M [\d. ML\n-]{400,}?)\s*"')
POINT = re.compile(r"[ML] (-?[\d.]+) (-?[\d.]+)")

# Decimals of a coordinate in points: 1/720 inch, finer than any screen or printer shows at this size.
DECIMALS = 1


@contextmanager
def drawing() -> Iterator[None]:
    """Context in which figures look alike on every machine: a user's own matplotlibrc must not change a page."""
    with mpl.rc_context():
        mpl.rcdefaults()
        mpl.rcParams.update(STYLE)
        yield


def colours() -> dict[str, str]:
    """Colours by the names that templates and the style sheet use."""
    return {
        "measured": MEASURED,
        "simulated": SIMULATED,
        "edge": SIMULATED_EDGE,
        "other": OTHER,
        "bad": BAD,
        "alike": ALIKE,
        "pale": PALE,
        "faint": FAINT,
        "paper": PAPER,
    }


def check_picture_path(path: Path) -> None:
    """Raises BadInput where the ending is not one of FORMATS."""
    if path.suffix.lower() not in FORMATS:
        raise BadInput(f"{path}: a picture ends in {', '.join(FORMATS)}; give --picture {path.stem or 'picture'}.svg")


def save_picture(figure: Figure, path: Path) -> None:
    """Writes the figure, all or nothing; the same figure gives the same bytes.

    Raises BadInput where its folder is missing, RigError where the disk refuses.
    """
    if not path.parent.is_dir():
        raise BadInput(f"{path}: cannot be written: {path.parent} is no folder; make it, or name another one")
    drawn, kind = io.BytesIO(), path.suffix.lower()
    # Without its date, an SVG has the same bytes each time.
    figure.savefig(drawn, format=kind.lstrip("."), dpi=200, metadata={"Date": None} if kind == ".svg" else None)
    write_atomically(path, drawn.getvalue())


def envelope(x: Floats, y: Floats, columns: int) -> tuple[Floats, Floats]:
    """At most two points, minimum and maximum, for each of `columns` equal intervals of x, so that no peak is lost.

    Parameters
    ----------
    x
        Positions (m,), ascending.
    y
        Values (m,), without NaN.
    columns
        Number of intervals.

    Returns
    -------
    x, y
        The points kept, both (k,), in their order, k <= 2 columns; all points where m <= 2 columns.
    """
    if len(x) <= 2 * columns:
        return x, y
    # The last point lies on the right border and would open a column of its own.
    column = np.minimum(((x - x[0]) / (x[-1] - x[0]) * columns).astype(np.intp), columns - 1)
    # Sorted by column, then by value: the first and the last entry of a column are its extremes.
    order = np.lexsort((y, column))
    starts = np.flatnonzero(np.diff(column[order], prepend=-1))
    ends = np.append(starts[1:], len(order)) - 1
    keep = np.unique(np.concatenate([order[starts], order[ends]]))
    return x[keep], y[keep]


def height_in(count: int, across: int) -> float:
    """Height in inches of a figure of `count` panels, `across` side by side."""
    # -(-a // b) is a divided by b, rounded up.
    return BOTTOM_IN + -(-count // across) * (TOP_IN + PANEL_IN)


def make_panels(count: int, across: int) -> tuple[Figure, list[Axes]]:
    """A figure of `count` panels, `across` side by side, with axes row by row; all share the scales of the first."""
    high_in = height_in(count, across)
    figure = Figure(figsize=(WIDTH_IN, high_in))
    width_in = (WIDTH_IN - LEFT_IN - (across - 1) * GAP_IN - 0.05) / across
    panels: list[Axes] = []
    for place in range(count):
        row, column = divmod(place, across)
        left_in, top_in = LEFT_IN + column * (width_in + GAP_IN), high_in - TOP_IN - row * (PANEL_IN + TOP_IN)
        box = (left_in / WIDTH_IN, (top_in - PANEL_IN + 0.06) / high_in, width_in / WIDTH_IN, (PANEL_IN - 0.06) / high_in)
        first = panels[0] if panels else None
        panels.append(figure.add_axes(box, sharex=first, sharey=first))
    return figure, panels


def mark_axes(panels: Sequence[Axes], across: int, below: str, beside: str) -> None:
    """Labels the outer panels: `below` and `beside` are the quantities with their units."""
    for place, axes in enumerate(panels):
        axes.tick_params(labelleft=place % across == 0, labelbottom=place + across >= len(panels))
        if place % across == 0:
            axes.set_ylabel(beside)
        if place + across >= len(panels):
            axes.set_xlabel(below)


def set_panel_title(axes: Axes, text: str) -> Text:
    """Sets a title above the panel, aligned left."""
    # parse_math=False: a "$" in a label is a character.
    return axes.set_title(text, loc="left", fontsize=8.8, pad=3.0, parse_math=False)


def compress_paths(svg: str) -> str:
    """The same drawing in fewer bytes; coordinates with one decimal, as `inline_svg` gives them, stay exact."""
    return LINE.sub(lambda found: f' d="{_in_steps(found[1])}"', svg)


def _in_steps(path: str) -> str:
    """Path in relative steps; each piece of an interrupted line begins with M."""
    return "".join(_piece(piece) for piece in re.split(r"(?=M)", path) if piece)


def _piece(piece: str) -> str:
    # In whole tenths: sums of steps are then exact, however long the line is.
    points = [(round(10.0 * float(x)), round(10.0 * float(y))) for x, y in POINT.findall(piece)]
    steps = [(x - x0, y - y0) for (x0, y0), (x, y) in pairwise(points)]
    return f"M{_tenths(points[0])}l{' '.join(_tenths(step) for step in steps)}" if steps else ""


def _tenths(pair: tuple[int, int]) -> str:
    return " ".join(_number(tenths) for tenths in pair).replace(" -", "-")


def _number(tenths: int) -> str:
    whole, tenth = divmod(abs(tenths), 10)
    text = (str(whole) if whole or not tenth else "") + (f".{tenth}" if tenth else "")
    return f"-{text}" if tenths < 0 else text


def inline_svg(figure: Figure, salt: str, label: str) -> str:
    """The figure as an <svg> element. The same figure and `salt` give the same bytes.

    Parameters
    ----------
    figure
        The figure to convert.
    salt
        Seed of the ids of clip paths and markers; it must differ between the figures of one page.
    label
        Description for screen readers, escaped for an attribute.
    """
    drawn = io.StringIO()
    # fonttype "none" keeps text as text, which can be searched and takes fewer bytes. No date, so that the bytes are reproducible.
    with mpl.rc_context({"svg.hashsalt": salt, "svg.fonttype": "none"}):
        figure.savefig(drawn, format="svg", transparent=True, metadata={"Date": None, "Creator": None, "Format": None, "Type": None})
    svg = drawn.getvalue()
    size = re.search(r'viewBox="[^"]*"', svg)
    body = svg[svg.index(">", svg.index("<svg")) + 1 :]
    box = size.group(0) if size else ""
    return f'<svg {box} role="img" aria-label="{label}">{compress_paths(_slim(body))}'.strip()


def _slim(body: str) -> str:
    body = re.sub(r"<metadata>.*?</metadata>|<defs>\s*<style.*?</style>\s*</defs>|<!--.*?-->", "", body, flags=re.DOTALL)
    body = re.sub(r'<g id="[^"]*"', "<g", body).replace("xlink:href", "href")
    # The page's style sheet sets the font; only its size stays with the text.
    body = re.sub(r"font-family: [^;\"]*;?|font: ([\d.]+px) [^;\"]*", lambda m: f"font-size: {m[1]}" if m[1] else "", body)
    body = re.sub(r'(?<= d=")[^"]*', lambda path: _round_coordinates(path[0]), body)
    return re.sub(r"\s*\n\s*", "\n", body)


def _round_coordinates(path: str) -> str:
    return re.sub(r"-?\d+\.\d+", lambda m: f"{float(m[0]):.{DECIMALS}f}", path)
