"""Figures of a diagnosis: the located residual, signals before and after in panels on one scale,
forest plots, measured laws.
"""

from collections.abc import Collection, Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from rfca_rig.diagnosis.residual_force.law import CatalogueCurve, MeasuredLaw
from rfca_rig.diagnosis.result import BeforeAfter, Diagnosis, SignalOverlay
from rfca_rig.escaping import html_text, printable
from rfca_rig.executors.parallel import map_in_processes, split_results
from rfca_rig.reports.style import (
    ALIKE,
    FAINT,
    MEASURED,
    OTHER,
    PALE,
    SIMULATED,
    SMALL,
    Panel,
    drawing,
    envelope,
    hover_values,
    inline_svg,
    make_panel,
)
from rfca_rig.reports.text import (
    count_noun,
    format_significant,
    keep_units_together,
    signal_words,
    words_and_unit,
)

Floats = NDArray[np.float64]
Interval = tuple[float, float, float]

DASHES = (0, (3.2, 1.8))
# Resolution of a line in a panel: two points for each column keep every peak.
COLUMNS = 90
# Curves that differ by less than this share of the signal's range (rms) look alike: a panel is 90
# points high, and the broad line takes 2.8 of them, 3 %.
COINCIDE = 0.02
RESIDUAL_IN = (4.7, 2.1)
# Share of a panel's height that marks the start of a window.
TICK = 0.045

WIDTH_IN = 4.4
HEIGHT_IN = 2.5
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
    """The panels of one signal. Where all curves coincide, `summary` says so in words, and a
    page folds the panels; else it is empty.
    """

    signal: str
    panels: tuple[Panel, ...]
    caption: str = ""
    summary: str = ""


def pictures_of(
    overlays: Sequence[SignalOverlay], never_folded: Collection[str] = ()
) -> list[Picture]:
    """One picture for each signal, in the order of the overlays; those in `never_folded` show a
    difference, however small it looks.
    """
    of_signal: dict[str, list[SignalOverlay]] = {}
    for overlay in overlays:
        of_signal.setdefault(overlay.signal, []).append(overlay)
    # Panel by panel, because signals differ in how long they take.
    tasks = []
    for signal_overlays in of_signal.values():
        limits = _limits_of(signal_overlays)
        tasks += [(number, overlay, limits) for number, overlay in enumerate(signal_overlays)]
    panels = map_in_processes(lambda task: _panel(*task), tasks)
    of_pictures = split_results(panels, map(len, of_signal.values()))
    pictures = []
    for (name, signal_overlays), own_panels in zip(of_signal.items(), of_pictures, strict=True):
        is_kept = name in never_folded
        pictures.append(_picture(name, signal_overlays, is_kept, tuple(own_panels)))
    return pictures


def _picture(
    signal: str, overlays: Sequence[SignalOverlay], is_kept: bool, panels: tuple[Panel, ...]
) -> Picture:
    unit = words_and_unit(signal)[1]
    fit = residuals_of(overlays)
    largest = fit.before
    if np.isfinite(fit.after):
        largest = max(fit.before, fit.after)
    coincide = np.isfinite(largest) and largest < COINCIDE * _span(
        np.concatenate([overlay.measured for overlay in overlays])
    )
    if any(overlay.parts and overlay.parts != (overlay.condition,) for overlay in overlays):
        caption = f"{count_noun(len(overlays), 'recording')} on one scale."
    else:
        caption = f"Means over the repeats, {count_noun(len(overlays), 'condition')} on one scale."
    summary = ""
    if coincide and not is_kept:
        summary = (
            f"{signal_words(signal)}: all curves coincide, rms {format_significant(largest, 2)} "
            f"{unit} at most"
        ).rstrip()
    return Picture(_quantity(signal), panels, caption, summary)


def residuals_of(overlays: Sequence[SignalOverlay]) -> BeforeAfter:
    """Rms of measured less simulated over all rows of the overlays, before and after; NaN where
    one is unknown everywhere.
    """
    before = np.concatenate([overlay.measured - overlay.before for overlay in overlays])
    after = np.concatenate([overlay.measured - overlay.after for overlay in overlays])
    return BeforeAfter(_rms(before), _rms(after))


def _rms(values: Floats) -> float:
    known = values[np.isfinite(values)]
    if known.size:
        return float(np.sqrt(np.mean(known**2)))
    return float("nan")


def _span(values: Floats) -> float:
    known = values[np.isfinite(values)]
    if known.size:
        return float(np.ptp(known))
    return 0.0


def _limits_of(overlays: Sequence[SignalOverlay]) -> list[tuple[float, float]]:
    """Limits of time and of all lines of a signal, the same for all its panels."""
    times_s = [overlay.t_s for overlay in overlays]
    lines = []
    for overlay in overlays:
        lines += [overlay.measured, overlay.before, overlay.after]
    return [_limits(np.concatenate(times_s)), _limits(np.concatenate(lines))]


def _limits(values: Floats) -> tuple[float, float]:
    """Limits of an axis for all panels, from finite values; (0, 1) where there are none."""
    known = values[np.isfinite(values)]
    if known.size:
        return (float(known.min()), float(known.max()))
    return (0.0, 1.0)


def _quantity(signal: str) -> str:
    words = signal_words(signal)
    unit = words_and_unit(signal)[1]
    if unit:
        return f"{words} ({unit})"
    return words


def _panel(number: int, overlay: SignalOverlay, limits: Sequence[tuple[float, float]]) -> Panel:
    """One condition. Lines of models are interrupted where a window starts from the measured
    state again, all lines in gaps.
    """
    t_s = overlay.t_s
    starts_s = overlay.starts_s
    unit = words_and_unit(overlay.signal)[1]
    windows = np.searchsorted(t_s, starts_s)
    if starts_s.size:
        gaps = 1 + np.flatnonzero(np.diff(t_s) > 1.5 * np.median(np.diff(t_s)))
    else:
        gaps = windows
    with drawing():
        figure, axes = make_panel(_quantity(overlay.signal), "time (s)")
        # Drawn from back to front: the measured line is the thinnest, and must stay visible where
        # all coincide.
        for values, color, lw, dashes, breaks in (
            (overlay.after, SIMULATED, 2.8, "-", windows),
            (overlay.before, OTHER, 1.1, DASHES, windows),
            (overlay.measured, MEASURED, 0.8, "-", gaps),
        ):
            x, y = _with_breaks(t_s, values, breaks, COLUMNS)
            if x.size:
                axes.plot(x, y, color=color, lw=lw, ls=dashes)
        axes.vlines(starts_s, 0.0, TICK, transform=axes.get_xaxis_transform(), color=FAINT, lw=0.6)
        (first_s, last_s), (low, high) = limits
        margin = 0.06 * (high - low) or 1.0
        axes.set_xlim(first_s, last_s)
        axes.set_ylim(low - margin, high + margin)
        lines = {"measured": overlay.measured, "before": overlay.before, "after": overlay.after}
        hovers = hover_values(axes, t_s, "s", lines, unit)
        label = (
            f"{signal_words(overlay.signal)} over time at {overlay.condition}: measured, "
            "nominal model, model accepted"
        )
        svg = inline_svg(
            figure, f"before and after {overlay.signal} {number}", html_text(label), hovers
        )
    return Panel(overlay.condition, svg)


def draw_residual(diagnosis: Diagnosis) -> Picture | None:
    """The residual before and after, over time, where the mismatch is largest; None without curves.

    It is the located signal and phase with the most standard deviations, or, where nothing was
    located, the largest cell of the map, in the condition with the largest residual. The phase is
    shaded.
    """
    drawn = {
        (curve.signal, part): curve
        for curve in diagnosis.overlays
        for part in curve.parts or (curve.condition,)
    }
    signals = {signal for signal, _ in drawn}
    places = [
        (place.sigmas, place.signal, place.phase, place.conditions)
        for place in diagnosis.located
        if place.signal in signals
    ]
    if not places:
        places = [
            (c.sigmas, c.signal, c.phase, (c.condition,))
            for c in diagnosis.cells
            if c.signal in signals and np.isfinite(c.sigmas)
        ]
    if not places:
        return None
    _, signal, phase, conditions = max(places, key=lambda place: place[0])
    curves = [drawn[signal, name] for name in conditions if (signal, name) in drawn]
    if not curves:
        return None
    overlay = max(
        curves,
        key=lambda curve: float(
            np.nan_to_num(np.abs(curve.measured - curve.before)).max(initial=0.0)
        ),
    )
    if overlay.phase.size:
        inside = overlay.phase == phase
    else:
        inside = np.zeros(len(overlay.t_s), dtype=bool)
    # A phase that fills the figure needs no shade.
    inside &= not inside.all()
    unit = words_and_unit(signal)[1]
    words = signal_words(signal)
    before = overlay.measured - overlay.before
    after = overlay.measured - overlay.after
    if inside.any():
        shown = inside
        where = f"{phase}, shaded"
    else:
        shown = np.ones(len(overlay.t_s), dtype=bool)
        where = phase
    numbers = " and ".join(
        f"{format_significant(_rms(values[shown]), 2)} {unit} {when}".replace("  ", " ")
        for values, when in ((before, "before"), (after, "after"))
        if np.isfinite(values[shown]).any()
    )
    windows = np.searchsorted(overlay.t_s, overlay.starts_s)
    with drawing():
        figure, axes = make_panel(_with_unit(f"residual of {words}", unit), "time (s)", RESIDUAL_IN)
        # Begin and end of each unbroken stretch of `inside`.
        edges = np.flatnonzero(np.diff(np.concatenate([[False], inside, [False]]).astype(int)))
        for begin, end in zip(edges[::2], edges[1::2], strict=True):
            axes.axvspan(float(overlay.t_s[begin]), float(overlay.t_s[end - 1]), color=PALE, lw=0.0)
        axes.axhline(0.0, color=FAINT, lw=0.6)
        for values, color, lw, dashes in (
            (after, SIMULATED, 2.4, "-"),
            (before, OTHER, 1.4, DASHES),
        ):
            x, y = _with_breaks(overlay.t_s, values, windows, COLUMNS)
            if x.size:
                axes.plot(x, y, color=color, lw=lw, ls=dashes)
        axes.margins(x=0.0, y=0.08)
        hovers = hover_values(
            axes, overlay.t_s, "s", {"residual before": before, "after": after}, unit
        )
        label = html_text(f"residual of {words} over time at {overlay.condition}, before and after")
        svg = inline_svg(figure, "residual located", label, hovers)
    count = len({curve.condition for curve in curves})
    if count > 1:
        others = f" The worst of {count} conditions where it shows."
    else:
        others = ""
    caption = f"Measured less simulated at {overlay.condition}. Rms ({where}): {numbers}.{others}"
    return Picture(f"Residual of {words}", (Panel("", svg),), keep_units_together(caption))


def _with_unit(words: str, unit: str) -> str:
    if unit:
        return f"{words} ({unit})"
    return words


def draw_forest(
    prior: Interval | None,
    posterior: Interval,
    axis: tuple[float, float],
    words: str,
    marker: float | None = None,
) -> str:
    """One row of a forest plot as inline SVG: the prior as a broad grey bar, the posterior as a dot
    with its interval, on a common axis.

    Parameters
    ----------
    prior, posterior
        Low end, middle and high end; None without a prior.
    axis
        The ends of the axis. What lies beyond is drawn at its end.
    words
        What a pointer shows, and a screen reader reads.
    marker
        Where a vertical line stands; None for none.
    """
    low, high = axis

    def at(value: float) -> str:
        return f"{4.0 + 172.0 * min(max((value - low) / (high - low), 0.0), 1.0):.1f}"

    parts = []
    if marker is not None:
        parts.append(f'<path class="zero" d="M{at(marker)} 0V18"/>')
    if prior is not None:
        # A prior of one number becomes a short bar, which is still seen.
        if prior[0] < prior[2]:
            begin = at(prior[0])
            end = at(prior[2])
        else:
            begin = at(prior[1])
            end = f"{float(at(prior[1])) + 3.0:.1f}"
        parts.append(f'<path class="prior" d="M{begin} 9H{end}"/>')
    parts.append(f'<path class="posterior" d="M{at(posterior[0])} 9H{at(posterior[2])}"/>')
    parts.append(f'<circle class="posterior" cx="{at(posterior[1])}" cy="9" r="3.5"/>')
    text = html_text(words)
    return (
        '<svg class="forest" viewBox="0 0 180 18" role="img" '
        f'aria-label="{text}"><title>{text}</title>{"".join(parts)}</svg>'
    )


def _with_breaks(
    t_s: Floats, values: Floats, breaks: NDArray[np.intp], columns: int
) -> tuple[Floats, Floats]:
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
            pieces += [
                *(np.append(part, np.nan) for part in envelope(at[known], piece[known], share))
            ]
    # Pieces alternate between times and values; the last NaN ends nothing.
    if pieces:
        return (np.concatenate(pieces[::2])[:-1], np.concatenate(pieces[1::2])[:-1])
    return (np.empty(0), np.empty(0))


def draw_law(law: MeasuredLaw, catalogue_curve: CatalogueCurve | None) -> str:
    """The residual law as inline SVG: its band of two standard deviations, the catalogue's law,
    and both branches where it has memory.
    """
    with drawing():
        figure = Figure(figsize=(WIDTH_IN, HEIGHT_IN), layout="constrained")
        axes = figure.subplots()
        axes.axhline(0.0, color=FAINT, lw=0.5)
        low = law.values - BAND * law.std
        high = law.values + BAND * law.std
        axes.fill_between(
            law.knots,
            low,
            high,
            color=ALIKE,
            alpha=0.55,
            lw=0.0,
            label=f"±{BAND:g} standard deviations",
        )
        if law.memory is not None and law.memory.has_memory:
            axes.plot(
                law.knots,
                law.memory.rising,
                color=MEASURED,
                lw=0.8,
                ls=":",
                label="while it rises, while it falls",
            )
            axes.plot(law.knots, law.memory.falling, color=MEASURED, lw=0.8, ls=":")
        if catalogue_curve is not None:
            axes.plot(
                catalogue_curve.argument,
                catalogue_curve.values,
                color=OTHER,
                lw=1.3,
                ls=DASHES,
                label=catalogue_curve.name,
            )
        axes.plot(
            law.knots, law.values, color=MEASURED, lw=1.2, marker="o", ms=2.6, label="measured"
        )
        axes.set_xlabel(printable(f"{_words(law)} ({law.argument_unit})"), parse_math=False)
        value_label = "change of the friction (share)"
        if law.unit:
            value_label = f"residual ({law.unit})"
        axes.set_ylabel(value_label)
        axes.set_xlim(law.visited)
        axes.legend(frameon=False, fontsize=SMALL, loc="best")
        label = f"measured law of {_words(law)} at {law.place} with its band"
        if catalogue_curve is not None:
            label += f", and {catalogue_curve.name} of the catalogue"
        return inline_svg(figure, f"measured law {law.place} {law.argument}", html_text(label))


def _words(law: MeasuredLaw) -> str:
    words = WORDS.get(law.argument, "reading")
    if law.place.startswith("hinge"):
        return words
    return words.replace("hinge", "joint")
