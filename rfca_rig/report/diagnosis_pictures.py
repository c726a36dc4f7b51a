"""Before and after: every condition's mean signal with both models, small multiples on one scale, one picture for each signal."""

from collections.abc import Sequence
from dataclasses import dataclass
from html import escape

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from rfca_rig.diagnosis.result import Overlay
from rfca_rig.report.envelope import envelope
from rfca_rig.report.inline_svg import inline_svg
from rfca_rig.report.light_paths import with_light_paths
from rfca_rig.report.named_units import shown, words_and_unit
from rfca_rig.report.overlay import MEASURED, SIMULATED, STYLE

Floats = NDArray[np.float64]

BEFORE = "#9a3a6a"  # dashed besides, so that it is known without its colour
DASHES = (0, (3.2, 1.8))
COLUMNS = 70  # of a panel
WIDTH_IN = 8.6
PANEL_IN = 1.3
LEFT_IN, BOTTOM_IN, TOP_IN, GAP_IN = 0.62, 0.5, 0.26, 0.28
USUAL_ACROSS, MOST_ACROSS = 3, 4


@dataclass(frozen=True)
class Picture:
    """One signal's panels as inline SVG."""

    signal: str
    svg: str


def pictures_of(overlays: Sequence[Overlay]) -> list[Picture]:
    """One picture for each signal, in the order of the overlays."""
    signals = dict.fromkeys(overlay.signal for overlay in overlays)
    return [Picture(shown(name), _drawn(name, [each for each in overlays if each.signal == name])) for name in signals]


def _drawn(signal: str, overlays: Sequence[Overlay]) -> str:
    across = _across([overlay.condition for overlay in overlays])
    down = -(-len(overlays) // across)
    height_in = BOTTOM_IN + down * (TOP_IN + PANEL_IN)
    with mpl.rc_context():
        mpl.rcdefaults()  # a reader's own matplotlibrc must not change the page
        mpl.rcParams.update(STYLE)
        figure = Figure(figsize=(WIDTH_IN, height_in))
        panels = _panels(figure, len(overlays), across, height_in)
        for axes, overlay in zip(panels, overlays, strict=True):
            _draw(axes, overlay)
        _mark_axes(panels, signal, across)
        label = f"{words_and_unit(signal)[0]} over time at {len(overlays)} conditions: measured, model as believed, model accepted"
        return with_light_paths(inline_svg(figure, f"before and after {signal}", escape(label, quote=True)))


def _across(conditions: Sequence[str]) -> int:
    """As many panels side by side as the first height has conditions, where that makes a good row."""
    alike = sum(label.split(", ")[0] == conditions[0].split(", ")[0] for label in conditions)
    return alike if 1 < alike <= MOST_ACROSS else min(USUAL_ACROSS, len(conditions))


def _panels(figure: Figure, count: int, across: int, height_in: float) -> list[Axes]:
    """Axes row by row, all on the scales of the first."""
    width_in = (WIDTH_IN - LEFT_IN - (across - 1) * GAP_IN - 0.05) / across
    panels: list[Axes] = []
    for place in range(count):
        row, column = divmod(place, across)
        left_in, top_in = LEFT_IN + column * (width_in + GAP_IN), height_in - TOP_IN - row * (PANEL_IN + TOP_IN)
        box = (left_in / WIDTH_IN, (top_in - PANEL_IN + 0.06) / height_in, width_in / WIDTH_IN, (PANEL_IN - 0.06) / height_in)
        first = panels[0] if panels else None
        panels.append(figure.add_axes(box, sharex=first, sharey=first))
    return panels


def _draw(axes: Axes, overlay: Overlay) -> None:
    _line(axes, overlay.t_s, overlay.after, color=SIMULATED, lw=2.8, dashes=None)
    _line(axes, overlay.t_s, overlay.before, color=BEFORE, lw=1.1, dashes=DASHES)
    _line(axes, overlay.t_s, overlay.measured, color=MEASURED, lw=0.8, dashes=None)
    axes.set_title(overlay.condition, loc="left", fontsize=8.8, pad=3.0, parse_math=False)
    axes.margins(x=0.0, y=0.06)


def _line(axes: Axes, t_s: Floats, values: Floats, *, color: str, lw: float, dashes: tuple[int, tuple[float, float]] | None) -> None:
    known = np.isfinite(values)
    if known.any():
        axes.plot(*envelope(t_s[known], values[known], COLUMNS), color=color, lw=lw, ls=dashes or "-")


def _mark_axes(panels: Sequence[Axes], signal: str, across: int) -> None:
    """Numbers only at the left and below; the quantities once."""
    words, unit = words_and_unit(signal)
    for place, axes in enumerate(panels):
        axes.tick_params(labelleft=place % across == 0, labelbottom=place + across >= len(panels))
        if place % across == 0:
            axes.set_ylabel(f"{words} ({unit})" if unit else words)
        if place + across >= len(panels):
            axes.set_xlabel("time (s)")
