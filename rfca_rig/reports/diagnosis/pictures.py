"""Figures of a diagnosis: signals before and after, as small multiples on one scale, and measured residual laws."""

from collections.abc import Sequence
from dataclasses import dataclass
from html import escape

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from rfca_rig.diagnosis.residual_force.law import CatalogueCurve, MeasuredLaw
from rfca_rig.diagnosis.result import SignalOverlay
from rfca_rig.reports.style import (
    ALIKE,
    FAINT,
    MEASURED,
    OTHER,
    SIMULATED,
    SMALL,
    drawing,
    envelope,
    inline_svg,
    make_panels,
    mark_axes,
    set_panel_title,
)
from rfca_rig.reports.text import count_noun, name_with_unit, words_and_unit

Floats = NDArray[np.float64]

DASHES = (0, (3.2, 1.8))
# Resolution of a line, over all panels side by side together: two points for each column keep every peak.
COLUMNS = 210
USUAL_ACROSS, MOST_ACROSS = 3, 4
# Share of a panel's height that marks the start of a window.
TICK = 0.045

WIDTH_IN, HEIGHT_IN = 4.4, 2.5
# Half width of the band in standard deviations.
BAND = 2.0
WORDS = {
    "rate_rad_s": "rate of the hinge",
    "angle_rad": "angle of the hinge",
    "speed_rad_s": "speed of the joint",
    "speed_m_s": "speed of the joint",
    "position_rad": "position of the joint",
    "position_m": "position of the joint",
    "spring_torque_Nm": "torque of the spring",
    "slip_m_s": "sliding speed of the tip",
    "load_N": "load on the tip",
    "depth_m": "depth of the tip in the floor",
    "time_s": "time",
    "shaft_angle_rad": "angle of the shaft",
}


@dataclass(frozen=True)
class Picture:
    """One signal's panels as inline SVG."""

    signal: str
    svg: str
    caption: str


def pictures_of(overlays: Sequence[SignalOverlay], across: int | None = None) -> list[Picture]:
    """One picture for each signal, in the order of the overlays; `across` panels side by side, None for as many as suit the conditions."""
    signals = dict.fromkeys(overlay.signal for overlay in overlays)
    return [_picture(name, [each for each in overlays if each.signal == name], across) for name in signals]


def _picture(signal: str, overlays: Sequence[SignalOverlay], across: int | None) -> Picture:
    conditions = count_noun(len(overlays), "condition")
    caption = f"Means over the repeats of {conditions}, all on one scale; how far repeats scatter is in the noise floor of the table above."
    return Picture(
        name_with_unit(signal), _draw_panels(signal, overlays, across or _across([overlay.condition for overlay in overlays])), caption
    )


def _draw_panels(signal: str, overlays: Sequence[SignalOverlay], across: int) -> str:
    with drawing():
        figure, panels = make_panels(len(overlays), across)
        for axes, overlay in zip(panels, overlays, strict=True):
            _draw(axes, overlay, COLUMNS // across)
        words, unit = words_and_unit(signal)
        mark_axes(panels, across, "time (s)", f"{words} ({unit})" if unit else words)
        label = f"{words_and_unit(signal)[0]} over time at {len(overlays)} conditions: measured, nominal model, model accepted"
        return inline_svg(figure, f"before and after {signal}", escape(label, quote=True))


def _across(conditions: Sequence[str]) -> int:
    """Panels side by side: as many as the first height has conditions, so that a row shows one height; else three."""
    alike = sum(label.split(", ")[0] == conditions[0].split(", ")[0] for label in conditions)
    return alike if 1 < alike <= MOST_ACROSS else min(USUAL_ACROSS, len(conditions))


def _draw(axes: Axes, overlay: SignalOverlay, columns: int) -> None:
    """Draws one condition. Lines of models are interrupted where a window starts from the measured state again, all lines in gaps."""
    t_s, starts_s = overlay.t_s, overlay.starts_s
    windows = np.searchsorted(t_s, starts_s)
    gaps = 1 + np.flatnonzero(np.diff(t_s) > 1.5 * np.median(np.diff(t_s))) if starts_s.size else windows
    # Drawn from back to front: the measured line is the thinnest, and must stay visible where all coincide.
    for values, color, lw, dashes, breaks in (
        (overlay.after, SIMULATED, 2.8, "-", windows),
        (overlay.before, OTHER, 1.1, DASHES, windows),
        (overlay.measured, MEASURED, 0.8, "-", gaps),
    ):
        x, y = _with_breaks(t_s, values, breaks, columns)
        if x.size:
            axes.plot(x, y, color=color, lw=lw, ls=dashes)
    axes.vlines(starts_s, 0.0, TICK, transform=axes.get_xaxis_transform(), color=FAINT, lw=0.6)
    set_panel_title(axes, overlay.condition)
    axes.margins(x=0.0, y=0.06)


def _with_breaks(t_s: Floats, values: Floats, breaks: NDArray[np.intp], columns: int) -> tuple[Floats, Floats]:
    """Finite points of a line, with NaN at its breaks, at most two for each column.

    Parameters
    ----------
    t_s, values
        The line, both (m,); `values` may hold NaN.
    breaks
        Indices (k,) before which the line is interrupted.
    columns
        Resolution of the whole line.
    """
    pieces = []
    for at, piece in zip(np.split(t_s, breaks), np.split(values, breaks), strict=True):
        known = np.isfinite(piece)
        if known.any():
            share = max(2, round(columns * known.sum() / len(t_s)))
            pieces += [*(np.append(part, np.nan) for part in envelope(at[known], piece[known], share))]
    # Pieces alternate between times and values; the last NaN ends nothing.
    return (np.concatenate(pieces[::2])[:-1], np.concatenate(pieces[1::2])[:-1]) if pieces else (np.empty(0), np.empty(0))


def draw_law(law: MeasuredLaw, catalogue_curve: CatalogueCurve | None) -> str:
    """The residual law as inline SVG: its band of two standard deviations, the catalogue's law, and both branches where it has memory."""
    with drawing():
        figure = Figure(figsize=(WIDTH_IN, HEIGHT_IN), layout="constrained")
        axes = figure.subplots()
        _draw_law(axes, law, catalogue_curve)
        label = f"measured law of {_words(law)} at {law.place} with its band"
        if catalogue_curve is not None:
            label += f", and {catalogue_curve.name} of the catalogue"
        return inline_svg(figure, f"measured law {law.place} {law.argument}", escape(label, quote=True))


def _draw_law(axes: Axes, law: MeasuredLaw, curve: CatalogueCurve | None) -> None:
    axes.axhline(0.0, color=FAINT, lw=0.5)
    low, high = law.values - BAND * law.std, law.values + BAND * law.std
    axes.fill_between(law.knots, low, high, color=ALIKE, alpha=0.55, lw=0.0, label=f"±{BAND:g} standard deviations")
    if law.memory is not None and law.memory.has_memory:
        axes.plot(law.knots, law.memory.rising, color=MEASURED, lw=0.8, ls=":", label="while it rises, while it falls")
        axes.plot(law.knots, law.memory.falling, color=MEASURED, lw=0.8, ls=":")
    if curve is not None:
        axes.plot(curve.argument, curve.values, color=OTHER, lw=1.3, ls=DASHES, label=curve.name)
    axes.plot(law.knots, law.values, color=MEASURED, lw=1.2, marker="o", ms=2.6, label="measured")
    axes.set_xlabel(f"{_words(law)} ({law.argument_unit})")
    axes.set_ylabel(f"residual ({law.unit})" if law.unit else "change of the friction (share)")
    axes.set_xlim(law.visited)
    axes.legend(frameon=False, fontsize=SMALL, loc="best")


def _words(law: MeasuredLaw) -> str:
    return WORDS.get(law.argument, "reading").replace("hinge", "hinge" if law.place.startswith("hinge") else "joint")
