"""Before and after: every condition's mean signal with both models, small multiples on one scale, one picture for each signal."""

from collections.abc import Sequence
from dataclasses import dataclass
from html import escape

import numpy as np
from matplotlib.axes import Axes
from numpy.typing import NDArray

from rfca_rig.diagnosis.result import Overlay
from rfca_rig.report.envelope import envelope
from rfca_rig.report.inline_svg import inline_svg
from rfca_rig.report.look import MEASURED, OTHER, SIMULATED, drawing
from rfca_rig.report.named_units import shown, words_and_unit
from rfca_rig.report.small_multiples import mark_axes, panels_of, title
from rfca_rig.report.wording import counted

Floats = NDArray[np.float64]

DASHES = (0, (3.2, 1.8))
COLUMNS = 70  # of a panel
USUAL_ACROSS, MOST_ACROSS = 3, 4


@dataclass(frozen=True)
class Picture:
    """One signal's panels as inline SVG."""

    signal: str
    svg: str
    caption: str


def pictures_of(overlays: Sequence[Overlay]) -> list[Picture]:
    """One picture for each signal, in the order of the overlays."""
    signals = dict.fromkeys(overlay.signal for overlay in overlays)
    return [_picture(name, [each for each in overlays if each.signal == name]) for name in signals]


def _picture(signal: str, overlays: Sequence[Overlay]) -> Picture:
    conditions = counted(len(overlays), "condition")
    caption = f"Means over the repeats of {conditions}, all on one scale; how far repeats scatter is in the noise floor of the table above."
    return Picture(shown(signal), _drawn(signal, overlays), caption)


def _drawn(signal: str, overlays: Sequence[Overlay]) -> str:
    across = _across([overlay.condition for overlay in overlays])
    with drawing():
        figure, panels = panels_of(len(overlays), across)
        for axes, overlay in zip(panels, overlays, strict=True):
            _draw(axes, overlay)
        words, unit = words_and_unit(signal)
        mark_axes(panels, across, "time (s)", f"{words} ({unit})" if unit else words)
        label = f"{words_and_unit(signal)[0]} over time at {len(overlays)} conditions: measured, model as believed, model accepted"
        return inline_svg(figure, f"before and after {signal}", escape(label, quote=True))


def _across(conditions: Sequence[str]) -> int:
    """As many panels side by side as the first height has conditions, where that makes a good row."""
    alike = sum(label.split(", ")[0] == conditions[0].split(", ")[0] for label in conditions)
    return alike if 1 < alike <= MOST_ACROSS else min(USUAL_ACROSS, len(conditions))


def _draw(axes: Axes, overlay: Overlay) -> None:
    _line(axes, overlay.t_s, overlay.after, color=SIMULATED, lw=2.8, dashes=None)
    _line(axes, overlay.t_s, overlay.before, color=OTHER, lw=1.1, dashes=DASHES)
    _line(axes, overlay.t_s, overlay.measured, color=MEASURED, lw=0.8, dashes=None)
    title(axes, overlay.condition)
    axes.margins(x=0.0, y=0.06)


def _line(axes: Axes, t_s: Floats, values: Floats, *, color: str, lw: float, dashes: tuple[int, tuple[float, float]] | None) -> None:
    known = np.isfinite(values)
    if known.any():
        axes.plot(*envelope(t_s[known], values[known], COLUMNS), color=color, lw=lw, ls=dashes or "-")
