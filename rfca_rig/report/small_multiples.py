"""Many small panels on one scale: numbers only at the left and below, the quantities once."""

from collections.abc import Sequence

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.text import Text

WIDTH_IN = 8.6
PANEL_IN = 1.3
LEFT_IN, BOTTOM_IN, TOP_IN, GAP_IN = 0.62, 0.5, 0.26, 0.28


def height_in(count: int, across: int) -> float:
    """Of the figure that holds them."""
    return BOTTOM_IN + -(-count // across) * (TOP_IN + PANEL_IN)


def panels_of(count: int, across: int) -> tuple[Figure, list[Axes]]:
    """A figure with axes row by row, all on the scales of the first."""
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
    """`below` and `beside` are the quantities with their units."""
    for place, axes in enumerate(panels):
        axes.tick_params(labelleft=place % across == 0, labelbottom=place + across >= len(panels))
        if place % across == 0:
            axes.set_ylabel(beside)
        if place + across >= len(panels):
            axes.set_xlabel(below)


def title(axes: Axes, text: str) -> Text:
    """Above the panel, from its left."""
    return axes.set_title(text, loc="left", fontsize=8.8, pad=3.0, parse_math=False)
