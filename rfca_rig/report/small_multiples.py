"""Small multiples: many panels on one scale, with tick labels only at the left and the bottom of the grid."""

from collections.abc import Sequence

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.text import Text

# Sizes in inches of the whole figure, a panel, and the margins for labels and titles.
WIDTH_IN = 8.6
PANEL_IN = 1.3
LEFT_IN, BOTTOM_IN, TOP_IN, GAP_IN = 0.62, 0.5, 0.26, 0.28


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
