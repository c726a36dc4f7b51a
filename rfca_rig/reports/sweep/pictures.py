"""Figures of a sweep: lines, maps with contours, and scatter plots over each sampled range."""

from collections.abc import Sequence
from html import escape

import numpy as np
from matplotlib.axes import Axes
from matplotlib.axis import XAxis, YAxis
from matplotlib.colors import LinearSegmentedColormap
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator, MaxNLocator, NullFormatter, ScalarFormatter
from numpy.typing import NDArray

from rfca_rig.reports.style import ALIKE, BAD, FAINT, MEASURED, OTHER, PALE, SIMULATED, SMALL, drawing, inline_svg
from rfca_rig.reports.sweep.views import View, axis_label, is_named, name_and_unit, value_text, with_unit
from rfca_rig.sweep.plan import Axis, Range

Floats = NDArray[np.float64]

WIDTH_IN, HEIGHT_IN = 4.6, 3.3
PANEL_IN, PANELS_HIGH_IN = 2.35, 2.3
PANELS_ACROSS = 4
# Points of a panel, the first ones: more only blacken it. Not every second point, because in a Sobol sequence those all lie
# in one half of a range.
MOST_POINTS = 1024
# Contours of a map, about.
LEVELS = 9
SHADES = LinearSegmentedColormap.from_list("shades", ["#f3f0ea", PALE, ALIKE, MEASURED])
# Colour, dashes and marker differ, so that lines can be distinguished without colour.
LINES = (
    (MEASURED, "-", "o"),
    (SIMULATED, "-", "s"),
    (OTHER, (0, (4, 1.5)), "D"),
    (FAINT, "-", "^"),
    (BAD, (0, (1.5, 1.5)), "v"),
    ("#1b1b1b", "-", "P"),
)


def draw_view(view: View, values: Floats, header: str) -> str:
    """Figure of one output as inline SVG.

    Parameters
    ----------
    view
        The view of the grid to draw.
    values
        Values (k, n) from `View.values`, NaN for failed cases.
    header
        Name of the output with its unit.
    """
    label = f"{name_and_unit(header)[0]} over {name_and_unit(view.x.name)[0]}"
    with drawing():
        figure = Figure(figsize=(WIDTH_IN, HEIGHT_IN), layout="constrained")
        axes = figure.add_subplot()
        if view.is_map and view.second is not None:
            _draw_map(figure, axes, view.x, view.second, values, header)
        else:
            _draw_lines(axes, view, values)
            axes.set_ylabel(axis_label(header))
        axes.set_xlabel(axis_label(view.x.name))
        return inline_svg(figure, f"{header} {view.facet}", escape(label, quote=True))


def _draw_lines(axes: Axes, view: View, values: Floats) -> None:
    x = np.arange(len(view.x.values), dtype=np.float64) if is_named(view.x) else np.array(view.x.values, dtype=np.float64)
    for place, (line, look) in enumerate(zip(values, LINES, strict=False)):
        colour, dash, marker = look
        lw, ms = (0.0, 5.5) if is_named(view.x) else (1.5, 3.4 if x.size <= 25 else 0.0)
        label = "" if view.second is None else with_unit(view.second.name, view.second.values[place])
        axes.plot(x, line, color=colour, ls=dash if lw else "", lw=lw, marker=marker, ms=ms, label=label)
    _set_scale(axes, view.x)
    if view.second is not None:
        axes.legend(frameon=False, fontsize=SMALL, handlelength=1.8)
    known = values[np.isfinite(values)]
    # Where no value is negative the axis starts at 0, so that heights show ratios.
    if known.size and known.min() >= 0.0 and known.max() > 0.0:
        axes.set_ylim(0.0, 1.06 * float(known.max()))
    axes.margins(x=0.04)


def _set_scale(axes: Axes, x: Axis) -> None:
    if is_named(x):
        axes.set_xticks(range(len(x.values)), [str(value) for value in x.values])
        axes.set_xlim(-0.5, len(x.values) - 0.5)
    elif x.log:
        _in_ratios(axes.xaxis)
    elif all(float(value).is_integer() for value in x.values):
        axes.xaxis.set_major_locator(MaxNLocator(integer=True))


def _in_ratios(axis: XAxis | YAxis) -> None:
    """Sets a logarithmic scale: plain numbers at 1, 2, 5 for up to three decades, else powers of ten."""
    low, high = sorted(axis.get_data_interval())
    set_scale = axis.axes.set_xscale if axis.axis_name == "x" else axis.axes.set_yscale
    set_scale("log")
    if high < 1e3 * low and low > 1e-2 and high < 1e4:
        axis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
        axis.set_major_formatter(ScalarFormatter())
        axis.set_minor_formatter(NullFormatter())


def _draw_map(figure: Figure, axes: Axes, x: Axis, y: Axis, values: Floats, header: str) -> None:
    across, up = np.array(x.values, dtype=np.float64), np.array(y.values, dtype=np.float64)
    known = np.ma.masked_invalid(values)
    if known.count() and known.max() > known.min():
        levels = MaxNLocator(LEVELS).tick_values(float(known.min()), float(known.max()))
        # Dark means a large magnitude: reversed where all values are negative.
        darkest_far_from_0 = SHADES.reversed() if known.max() <= 0.0 else SHADES
        shades = axes.contourf(across, up, known, levels=levels, cmap=darkest_far_from_0)
        lines = axes.contour(across, up, known, levels=levels[1:-1], colors="#1b1b1b", linewidths=0.5, linestyles="solid")
        axes.clabel(lines, fontsize=SMALL - 1.0, fmt=lambda level: value_text(float(level)))
        figure.colorbar(shades, ax=axes, label=axis_label(header), aspect=30, pad=0.02)
    # Failed cases are marked: a gap in a map could be taken for a value.
    missing = np.argwhere(np.isnan(values))
    axes.plot(across[missing[:, 1]], up[missing[:, 0]], ls="", marker="x", ms=4.5, mew=1.0, color=BAD, clip_on=False)
    for direction, axis in ((axes.xaxis, x), (axes.yaxis, y)):
        if axis.log:
            _in_ratios(direction)
    axes.set_ylabel(axis_label(y.name))


def draw_points(ranges: Sequence[Range], points: Floats, values: Floats, titles: Sequence[str], header: str) -> str:
    """Scatter plots of one output as inline SVG, one panel for each sampled quantity.

    Parameters
    ----------
    ranges
        The k sampled quantities.
    points
        Sampled points (n, k).
    values
        Output (n,), NaN for failed cases.
    titles
        Title of each panel.
    header
        Name of the output with its unit.
    """
    rows, across = -(-len(ranges) // PANELS_ACROSS), min(len(ranges), PANELS_ACROSS)
    with drawing():
        figure = Figure(figsize=(PANEL_IN * across + 0.4, PANELS_HIGH_IN * rows), layout="constrained")
        panels = figure.subplots(rows, across, sharey=True, squeeze=False).ravel()
        for place, (each, axes) in enumerate(zip(ranges, panels, strict=False)):
            # Lines without length and with round ends, all in one path: a quarter of the bytes of markers.
            x = points[:MOST_POINTS, place]
            y = values[:MOST_POINTS]
            # NaN after each point interrupts the path.
            nowhere = np.full(x.size, np.nan)
            axes.plot(
                np.stack((x, x, nowhere), axis=1).ravel(),
                np.stack((y, y, nowhere), axis=1).ravel(),
                color=MEASURED,
                lw=2.0,
                alpha=0.6,
                solid_capstyle="round",
            )
            axes.set_title(titles[place], fontsize=SMALL)
            axes.set_xlabel(axis_label(each.name), fontsize=SMALL)
            if each.log:
                _in_ratios(axes.xaxis)
            else:
                axes.xaxis.set_major_locator(MaxNLocator(4))
        for axes in panels[len(ranges) :]:
            axes.set_visible(False)
        for axes in panels[::across]:
            axes.set_ylabel(axis_label(header))
        return inline_svg(figure, f"{header} points", escape(f"{name_and_unit(header)[0]} over what was drawn", quote=True))
