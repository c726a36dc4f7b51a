"""Common style of all figures: colours with one meaning everywhere, line widths, font sizes.

Measured is a dark thin line over simulated, a broad lighter one. The two differ in greyscale and
for every kind of colour vision. Both have a contrast of at least 3 : 1 to the paper and to each
other (WCAG 2, graphics), and both remain visible where they coincide.

Inline figures refer to the colours by name, so that a page in dark mode replaces them. Also panels
on one scale, values that a pointer shows, decimation of lines, inline SVG without ids that two
figures could share, and pictures as files.
"""

import io
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import wraps
from itertools import pairwise
from pathlib import Path
from typing import Any, TypeVar

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from rfca_rig.errors import BadInput
from rfca_rig.escaping import html_text, printable
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
# Words in a figure that stand back.
SOFT = "#555555"

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
SMALL = 9.0

FORMATS = (".svg", ".png", ".pdf")

Floats = NDArray[np.float64]
Drawn = TypeVar("Drawn")

# The same on dark paper, with the contrasts of the light colours.
DARK = {
    "measured": "#cfe2fa",
    "simulated": "#a8670f",
    "edge": "#f0c78a",
    "other": "#d678a8",
    "bad": "#ff9a5c",
    "alike": "#47648a",
    "pale": "#2c2f34",
    "faint": "#8d8d8d",
    "paper": "#15171a",
}

# Sizes in inches of a figure across the page, and of a panel, with its margins for tick labels and
# titles.
WIDTH_IN = 8.6
# On a phone a wide figure is replaced by one of this width, whose letters are as large as the
# page's.
NARROW_IN = 4.4
PANEL_IN = (4.2, 1.95)
LEFT_IN = 0.68
BOTTOM_IN = 0.46
TOP_IN = 0.24
RIGHT_IN = 0.1
# Values that a pointer finds along one panel.
HOVERS = 24

# Paths of 400 characters or more; on shorter ones little is saved.
LINE = re.compile(r' d="(M [\d. ML\n-]{400,}?)\s*"')
POINT = re.compile(r"[ML] (-?[\d.]+) (-?[\d.]+)")

# Decimals of a coordinate in points: 1/720 inch, finer than any screen or printer shows at this
# size.
DECIMALS = 1


@contextmanager
def drawing() -> Iterator[None]:
    """Context in which figures look alike on every machine: a user's own matplotlibrc must not
    change a page.
    """
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
        raise BadInput(
            f"{path}: a picture ends in {', '.join(FORMATS)}; give --picture "
            f"{path.stem or 'picture'}.svg"
        )


def save_picture(figure: Figure, path: Path) -> None:
    """Writes the figure, all or nothing; the same figure gives the same bytes.

    Raises BadInput where its folder is missing, RigError where the disk refuses.
    """
    if not path.parent.is_dir():
        raise BadInput(
            f"{path}: cannot be written: {path.parent} is no folder; make it, or name another one"
        )
    drawn = io.BytesIO()
    kind = path.suffix.lower()
    # Without its date, a picture has the same bytes each time.
    metadata: dict[str, None] | None = {".svg": {"Date": None}, ".pdf": {"CreationDate": None}}.get(
        kind
    )
    figure.savefig(drawn, format=kind.lstrip("."), dpi=200, metadata=metadata)
    write_atomically(path, drawn.getvalue())


def envelope(x: Floats, y: Floats, columns: int) -> tuple[Floats, Floats]:
    """At most two points, minimum and maximum, for each of `columns` equal intervals of x, so that
    no peak is lost.

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


@dataclass(frozen=True)
class Hover:
    """Text that a pointer shows between `left` and `right`, in the data coordinates of `axes`."""

    axes: Axes
    left: float
    right: float
    text: str


@dataclass(frozen=True)
class Panel:
    """One of several figures on a common scale: its title and inline SVG.

    `wide` scrolls on a narrow screen; `ended` marks a stroke that was cut short.
    """

    title: str
    svg: str
    wide: bool = False
    ended: bool = False


def make_panel(
    quantity: str, x_name: str, size_in: tuple[float, float] = PANEL_IN
) -> tuple[Figure, Axes]:
    """A figure of one panel. `quantity` with its unit is above the axis, where no tick label
    pushes it out of the figure.
    """
    wide, high = size_in
    figure = Figure(figsize=size_in)
    box = (
        LEFT_IN / wide,
        BOTTOM_IN / high,
        (wide - LEFT_IN - RIGHT_IN) / wide,
        (high - BOTTOM_IN - TOP_IN) / high,
    )
    axes = figure.add_axes(box)
    # parse_math=False: a "$" in a name is a character.
    axes.set_title(
        printable(quantity),
        loc="left",
        x=-LEFT_IN / (wide - LEFT_IN - RIGHT_IN),
        fontsize=9.2,
        pad=3.5,
        parse_math=False,
    )
    axes.set_xlabel(printable(x_name), labelpad=2.0, parse_math=False)
    return figure, axes


def hover_values(
    axes: Axes, x: Floats, x_unit: str, series: Mapping[str, Floats], unit: str, count: int = HOVERS
) -> list[Hover]:
    """Values of lines over equal stretches of x, each taken in the middle of its stretch.

    Parameters
    ----------
    axes
        Where the lines are drawn.
    x
        Positions (m,), ascending, with their unit in `x_unit`.
    series
        Values (m,) by the name of their line, in `unit`; NaN where unknown.
    count
        Number of stretches.
    """
    if len(x) < 2:
        return []
    hovers = []
    edges = np.linspace(x[0], x[-1], count + 1)
    # Rounding errors of a line that is zero are zero to a reader.
    least = 1e-6 * max(
        (np.abs(values[np.isfinite(values)]).max(initial=0.0) for values in series.values()),
        default=0.0,
    )
    for left, right in pairwise(edges.tolist()):
        at = int(np.argmin(np.abs(x - 0.5 * (left + right))))
        if not left <= x[at] <= right:
            continue
        values = ", ".join(
            f"{name} {values[at] if abs(values[at]) > least else 0.0:.3g}"
            for name, values in series.items()
            if np.isfinite(values[at])
        )
        hovers.append(
            Hover(
                axes,
                left,
                right,
                f"{x[at]:.3f} {x_unit}: {values} {unit}".strip().replace("-", "\u2212"),
            )
        )
    return hovers


def compress_paths(svg: str) -> str:
    """The same drawing in fewer bytes; coordinates with one decimal, as `inline_svg` gives them,
    stay exact.
    """
    # Path in relative steps; each piece of an interrupted line begins with M.
    return LINE.sub(
        lambda match: (
            f' d="{"".join(_piece(piece) for piece in re.split(r"(?=M)", match[1]) if piece)}"'
        ),
        svg,
    )


def _piece(piece: str) -> str:
    # In whole tenths: sums of steps are then exact, however long the line is.
    points = [(round(10.0 * float(x)), round(10.0 * float(y))) for x, y in POINT.findall(piece)]
    steps = [(x - x0, y - y0) for (x0, y0), (x, y) in pairwise(points)]
    if steps:
        return f"M{_tenths(points[0])}l{' '.join(_tenths(step) for step in steps)}"
    return ""


def _tenths(pair: tuple[int, int]) -> str:
    return " ".join(_number(tenths) for tenths in pair).replace(" -", "-")


def _number(tenths: int) -> str:
    whole, tenth = divmod(abs(tenths), 10)
    text = ""
    if whole or not tenth:
        text = str(whole)
    if tenth:
        text += f".{tenth}"
    if tenths < 0:
        return f"-{text}"
    return text


def inline_svg(figure: Figure, salt: str, label: str, hovers: Sequence[Hover] = ()) -> str:
    """The figure as an <svg> element. The same figure and `salt` give the same bytes.

    Parameters
    ----------
    figure
        The figure to convert.
    salt
        Seed of the ids of clip paths and markers; it must differ between the figures of one page.
    label
        Description for screen readers, escaped for an attribute.
    hovers
        Values that a pointer shows.
    """
    drawn = io.StringIO()
    # fonttype "none" keeps text as text, which can be searched and takes fewer bytes. No date, so
    # that the bytes are reproducible.
    with mpl.rc_context({"svg.hashsalt": salt, "svg.fonttype": "none"}):
        figure.savefig(
            drawn,
            format="svg",
            transparent=True,
            metadata={"Date": None, "Creator": None, "Format": None, "Type": None},
        )
    svg = drawn.getvalue()
    size = re.search(r'viewBox="[^"]*"', svg)
    body = _name_colours(compress_paths(_slim(svg[svg.index(">", svg.index("<svg")) + 1 :])))
    # The width in points: on a narrow screen a figure scrolls rather than becoming too small to
    # read.
    style = f'style="--width: {72.0 * figure.get_figwidth():.0f}px"'
    pointed = "".join(_hover_area(hover, figure) for hover in hovers)
    end = body.rindex("</svg>")
    view_box = ""
    if size:
        view_box = size[0]
    return (
        f'<svg {view_box} role="img" aria-label="{label}" {style}>{body[:end]}{pointed}{body[end:]}'
    ).strip()


def for_both_widths(draw: Callable[[Drawn, bool], str]) -> Callable[[Drawn], str]:
    """Decorator: a figure across the page and, for a narrow screen, the same redrawn in its width;
    the style sheet shows one of them.

    `draw` returns the narrow figure where its second argument is True.
    """

    @wraps(draw)
    def both(drawn: Drawn) -> str:
        pair = ((False, "desk"), (True, "phone"))
        return "".join(
            draw(drawn, is_narrow).replace("<svg ", f'<svg class="{name}" ', 1)
            for is_narrow, name in pair
        )

    return both


def _hover_area(hover: Hover, figure: Figure) -> str:
    """A transparent rectangle over the panel's height with its text, in points from the top left
    corner.
    """
    points = 72.0 / figure.dpi
    (left, right) = (
        hover.axes.transData.transform([[x, 0.0] for x in (hover.left, hover.right)])[:, 0] * points
    )
    box = hover.axes.bbox
    top = 72.0 * figure.get_figheight() - box.y1 * points
    attributes = (
        f'x="{left:.1f}" y="{top:.1f}" width="{right - left:.1f}" '
        f'height="{box.height * points:.1f}"'
    )
    return f'<rect class="hover" {attributes}><title>{html_text(hover.text)}</title></rect>'


def _name_colours(svg: str) -> str:
    """The drawing with palette colours as variables of the page's style sheet, and black as the
    colour of the text.
    """
    for name, value in {**colours(), "soft": SOFT}.items():
        svg = svg.replace(value, f"var(--{name})")
    return re.sub(r"#000000\b", "currentColor", svg)


def _slim(body: str) -> str:
    body = re.sub(
        r"<metadata>.*?</metadata>|<defs>\s*<style.*?</style>\s*</defs>|<!--.*?-->",
        "",
        body,
        flags=re.DOTALL,
    )
    body = re.sub(r'<g id="[^"]*"', "<g", body).replace("xlink:href", "href")
    # The page's style sheet sets the font; only its size stays with the text.
    body = re.sub(
        r"font-family: [^;\"]*;?|font: ([\d.]+px) [^;\"]*",
        lambda m: f"font-size: {m[1]}" if m[1] else "",
        body,
    )
    body = re.sub(
        r'(?<= d=")[^"]*',
        lambda path: re.sub(r"-?\d+\.\d+", lambda m: f"{float(m[0]):.{DECIMALS}f}", path[0]),
        body,
    )
    return re.sub(r"\s*\n\s*", "\n", body)
