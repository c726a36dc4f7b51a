"""Figures of a sweep: their choice, in which words, and their drawing.

Lines over one quantity, maps with contours over two, scatter plots over each sampled range.
Sensitivities are first-order Sobol indices of each output for each sampled quantity, for the page
and sweep.json.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import product
from math import prod

import numpy as np
from matplotlib.axes import Axes
from matplotlib.axis import XAxis, YAxis
from matplotlib.colors import LinearSegmentedColormap
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator, MaxNLocator, NullFormatter, ScalarFormatter
from numpy.typing import NDArray

from rfca_rig.escaping import html_text
from rfca_rig.reports.style import (
    ALIKE,
    BAD,
    FAINT,
    MEASURED,
    OTHER,
    PALE,
    SIMULATED,
    SMALL,
    drawing,
    inline_svg,
)
from rfca_rig.reports.table import Table, TableColumn, TableRow
from rfca_rig.reports.text import MINUS, words_and_unit
from rfca_rig.sweep.plan import Axis, FirstOrder, Range, SweepPlan, first_order, shares
from rfca_rig.sweep.quantities import Value
from rfca_rig.sweep.result import SweepResult

Floats = NDArray[np.float64]

# Lines of one figure that can still be distinguished; more become a map.
MOST_LINES = 6
# Values along the shorter side from which on a grid is drawn as a map.
FEWEST_OF_A_MAP = 5
# Figures of one output at most.
MOST_FACETS = 6

DIGITS = 4
# Replaced in this order: longer spellings come before their parts ("phi_i" before "phi").
SIGNS = {
    "integral of ": "∫ ",
    "tau w": "τ ω",
    "tau": "τ",
    "dphi_i": "dφᵢ",
    "phi_i": "φᵢ",
    "phi": "φ",
    "sum ": "Σ ",
    "N_k": "Nₖ",
    "F_k": "Fₖ",
    "^2": "²",
    " - ": f" {MINUS} ",
}

# Combinations of the grid's values for which sensitivities are computed.
MOST_GROUPS = 6


@dataclass(frozen=True)
class View:
    """One view of a grid: `x` is the horizontal axis, `second` gives lines or the vertical axis,
    the others are fixed at `facet`.
    """

    x: Axis
    second: Axis | None
    is_map: bool
    facet: tuple[tuple[str, Value], ...]

    def values(self, result: SweepResult, header: str) -> Floats:
        """Values (k, n) of an output, k along `second` (1 without), n along `x`; NaN for failed
        cases.
        """
        plan = result.plan
        grid = result.output(header).reshape([len(axis.values) for axis in plan.axes])
        fixed = dict(self.facet)
        # A number removes an axis of the grid, a slice keeps it.
        picked = tuple(
            axis.values.index(fixed[axis.name]) if axis.name in fixed else slice(None)
            for axis in plan.axes
        )
        left = [axis.name for axis in plan.axes if axis.name not in fixed]
        order = [left.index(axis.name) for axis in (self.second, self.x) if axis is not None]
        return np.atleast_2d(np.transpose(grid[picked], order))


def is_named(axis: Axis) -> bool:
    """Whether its values are words."""
    return isinstance(axis.values[0], str)


def views(plan: SweepPlan) -> tuple[list[View], int]:
    """The views of a grid, at most MOST_FACETS, and their number without that limit. A sweep
    with samples has none.
    """
    if plan.samples is not None or not plan.axes:
        return [], 0
    # The horizontal axis is the one with the most numbers, so that a line has many points. Two
    # points give no line, and words are then easier to read along the bottom.
    x = max(
        plan.axes,
        key=lambda axis: (
            not is_named(axis) and len(axis.values) > 2,
            is_named(axis),
            len(axis.values),
        ),
    )
    others = sorted(
        (axis for axis in plan.axes if axis is not x), key=lambda axis: -len(axis.values)
    )
    second = next(iter(others), None)
    rest = [axis for axis in plan.axes if axis not in (x, second)]
    choices = []
    for axis in rest:
        choices.append([(axis.name, value) for value in axis.values])
    facets = list(product(*choices))
    return [View(x, second, _as_map(x, second), facet) for facet in facets[:MOST_FACETS]], len(
        facets
    )


def _as_map(x: Axis, second: Axis | None) -> bool:
    if second is None or is_named(second) or is_named(x):
        return False
    return (
        min(len(x.values), len(second.values)) >= FEWEST_OF_A_MAP or len(second.values) > MOST_LINES
    )


@dataclass(frozen=True)
class SampleGroup:
    """Sampled cases of one combination of the grid's values, as a slice of all cases."""

    at: tuple[tuple[str, Value], ...]
    cases: slice


def sample_groups(plan: SweepPlan) -> Iterator[SampleGroup]:
    """Sampled cases for each combination of the grid, in order; none without samples."""
    if plan.samples is None:
        return
    n = plan.samples.n
    names: Sequence[str] = [axis.name for axis in plan.axes]
    for number in range(prod(len(axis.values) for axis in plan.axes)):
        yield SampleGroup(
            tuple(zip(names, plan.point(number * n), strict=False)),
            slice(number * n, (number + 1) * n),
        )


def name_and_unit(name: str) -> tuple[str, str]:
    """Words and unit: strip.thickness_mm is "strip thickness" in mm, static_torque_Nm@60deg is
    "static torque at 60°" in N m.
    """
    plain, at, angle = name.partition("@")
    of, dot, last = plain.rpartition(".")
    words, unit = words_and_unit(last)
    if dot:
        words = f"{of.replace('_', ' ')} {words}"
    if at:
        words = f"{words} at {angle.removesuffix('deg')}°"
    return words, unit


def axis_label(name: str) -> str:
    """Label of an axis, as in "height (mm)"."""
    words, unit = name_and_unit(name)
    if unit:
        return f"{words} ({unit})"
    return words


def with_unit(name: str, value: Value) -> str:
    """Name with value and unit, as in "height 215 mm", "strip material CFSP"."""
    words, unit = name_and_unit(name)
    if not unit:
        return f"{words} {value_text(value)}"
    return f"{words} {value_text(value)} {unit}"


def value_text(value: Value) -> str:
    """A value with four digits and a typographic minus sign."""
    if isinstance(value, str):
        return value
    return f"{value:.{DIGITS}g}".replace("-", MINUS)


def formula(text: str) -> str:
    """An equation in mathematical signs, for a page."""
    for typed, sign in SIGNS.items():
        text = text.replace(typed, sign)
    if text.startswith("-"):
        return f"{MINUS}{text[1:]}"
    return text


@dataclass(frozen=True)
class OutputSensitivity:
    """Sensitivity of one output to one quantity, for one combination of the grid's values;
    `found` is None where it is undetermined.
    """

    at: tuple[tuple[str, Value], ...]
    output: str
    name: str
    found: FirstOrder | None


def compute_sensitivities(result: SweepResult) -> list[OutputSensitivity]:
    """All sensitivities, by combination, output and quantity. The seed of the bootstrap is that
    of the samples.
    """
    return list(_compute_sensitivities(result))


def _compute_sensitivities(result: SweepResult) -> Iterator[OutputSensitivity]:
    samples = result.plan.samples
    if samples is None:
        return
    share = shares(samples)
    for group in list(sample_groups(result.plan))[:MOST_GROUPS]:
        for asked in result.plan.outputs:
            values = result.output(asked.header)[group.cases]
            for column, name in enumerate(samples.names):
                # A generator of its own for each quantity, so that the order of computation does
                # not matter.
                rng = np.random.default_rng((samples.seed, column))
                yield OutputSensitivity(
                    group.at, asked.header, name, first_order(share[:, column], values, rng)
                )


def sensitivities_table(found: list[OutputSensitivity]) -> Table:
    """A row for each output, a column for each quantity, and the sum of its indices; what it
    lacks of 1 is due to interactions.
    """
    names = list(dict.fromkeys(sensitivity.name for sensitivity in found))
    columns = [TableColumn("at", role="group"), TableColumn("output")]
    for name in names:
        # A share has no unit, so its key does not end as the name of the quantity.
        share = f"{name} share"
        std = f"{name} std"
        columns += [
            TableColumn(share, name_and_unit(name)[0], half=std),
            TableColumn(std, role="kept"),
        ]
    columns.append(TableColumn("sum", "together", digits=2))
    rows = []
    for at, output in dict.fromkeys((sensitivity.at, sensitivity.output) for sensitivity in found):
        values: dict[str, str | float | None] = {
            "at": ", ".join(with_unit(*setting) for setting in at),
            "output": name_and_unit(output)[0],
        }
        of_row = [
            sensitivity
            for sensitivity in found
            if (sensitivity.at, sensitivity.output) == (at, output)
        ]
        for sensitivity in of_row:
            if sensitivity.found:
                values[f"{sensitivity.name} share"] = sensitivity.found.index
                values[f"{sensitivity.name} std"] = sensitivity.found.std
            else:
                values[f"{sensitivity.name} share"] = None
                values[f"{sensitivity.name} std"] = None
        if all(sensitivity.found for sensitivity in of_row):
            values["sum"] = sum(
                sensitivity.found.index for sensitivity in of_row if sensitivity.found
            )
        else:
            values["sum"] = None
        rows.append(TableRow(values))
    return Table(
        "sensitivities",
        "Share of an output's variance that one quantity explains alone (first-order "
        "Sobol index ± one standard error); what is missing "
        "from 1 together is due to interactions.",
        tuple(columns),
        tuple(rows),
    )


WIDTH_IN = 4.6
HEIGHT_IN = 3.3
PANEL_IN = 2.35
PANELS_HIGH_IN = 2.3
PANELS_ACROSS = 4
# Points of a panel, the first ones: more only blacken it. Not every second point, because in a
# Sobol sequence those all lie in one half of a range.
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
        return inline_svg(figure, f"{header} {view.facet}", html_text(label))


def _draw_lines(axes: Axes, view: View, values: Floats) -> None:
    if is_named(view.x):
        x = np.arange(len(view.x.values), dtype=np.float64)
    else:
        x = np.array(view.x.values, dtype=np.float64)
    for index, (line, look) in enumerate(zip(values, LINES, strict=False)):
        colour, dash, marker = look
        if is_named(view.x):
            lw = 0.0
            ms = 5.5
        else:
            lw = 1.5
            ms = 3.4 if x.size <= 25 else 0.0
        if view.second is None:
            label = ""
        else:
            label = with_unit(view.second.name, view.second.values[index])
        axes.plot(
            x, line, color=colour, ls=dash if lw else "", lw=lw, marker=marker, ms=ms, label=label
        )
    if is_named(view.x):
        axes.set_xticks(range(len(view.x.values)), [str(value) for value in view.x.values])
        axes.set_xlim(-0.5, len(view.x.values) - 0.5)
    elif view.x.log:
        _in_ratios(axes.xaxis)
    elif all(float(value).is_integer() for value in view.x.values):
        axes.xaxis.set_major_locator(MaxNLocator(integer=True))
    if view.second is not None:
        axes.legend(frameon=False, fontsize=SMALL, handlelength=1.8)
    known = values[np.isfinite(values)]
    # Where no value is negative the axis starts at 0, so that heights show ratios.
    if known.size and known.min() >= 0.0 and known.max() > 0.0:
        axes.set_ylim(0.0, 1.06 * float(known.max()))
    axes.margins(x=0.04)


def _in_ratios(axis: XAxis | YAxis) -> None:
    """Sets a logarithmic scale: plain numbers at 1, 2, 5 for up to three decades, else powers of
    ten.
    """
    low, high = sorted(axis.get_data_interval())
    if axis.axis_name == "x":
        set_scale = axis.axes.set_xscale
    else:
        set_scale = axis.axes.set_yscale
    set_scale("log")
    if high < 1e3 * low and low > 1e-2 and high < 1e4:
        axis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
        axis.set_major_formatter(ScalarFormatter())
        axis.set_minor_formatter(NullFormatter())


def _draw_map(figure: Figure, axes: Axes, x: Axis, y: Axis, values: Floats, header: str) -> None:
    across = np.array(x.values, dtype=np.float64)
    up = np.array(y.values, dtype=np.float64)
    known = np.ma.masked_invalid(values)
    if known.count() and known.max() > known.min():
        levels = MaxNLocator(LEVELS).tick_values(float(known.min()), float(known.max()))
        # Dark means a large magnitude: reversed where all values are negative.
        if known.max() <= 0.0:
            darkest_far_from_0 = SHADES.reversed()
        else:
            darkest_far_from_0 = SHADES
        shades = axes.contourf(across, up, known, levels=levels, cmap=darkest_far_from_0)
        lines = axes.contour(
            across,
            up,
            known,
            levels=levels[1:-1],
            colors="#1b1b1b",
            linewidths=0.5,
            linestyles="solid",
        )
        for label in axes.clabel(lines, fontsize=SMALL, fmt=lambda level: value_text(float(level))):
            # Near the border the axes would cut it.
            label.set_clip_on(False)
        figure.colorbar(shades, ax=axes, label=axis_label(header), aspect=30, pad=0.02)
    # Failed cases are marked: a gap in a map could be taken for a value.
    missing = np.argwhere(np.isnan(values))
    axes.plot(
        across[missing[:, 1]],
        up[missing[:, 0]],
        ls="",
        marker="x",
        ms=4.5,
        mew=1.0,
        color=BAD,
        clip_on=False,
    )
    for direction, axis in ((axes.xaxis, x), (axes.yaxis, y)):
        if axis.log:
            _in_ratios(direction)
    axes.set_ylabel(axis_label(y.name))


def draw_points(
    ranges: Sequence[Range], points: Floats, values: Floats, titles: Sequence[str], header: str
) -> str:
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
    rows = -(-len(ranges) // PANELS_ACROSS)
    across = min(len(ranges), PANELS_ACROSS)
    with drawing():
        figure = Figure(
            figsize=(PANEL_IN * across + 0.3, PANELS_HIGH_IN * rows), layout="constrained"
        )
        panels = figure.subplots(rows, across, sharey=True, squeeze=False).ravel()
        for column, (quantity, axes) in enumerate(zip(ranges, panels, strict=False)):
            # Lines without length and with round ends, all in one path: a quarter of the bytes of
            # markers.
            x = points[:MOST_POINTS, column]
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
            axes.set_title(titles[column], fontsize=SMALL)
            axes.set_xlabel(axis_label(quantity.name), fontsize=SMALL)
            if quantity.log:
                _in_ratios(axes.xaxis)
            else:
                axes.xaxis.set_major_locator(MaxNLocator(4))
        for axes in panels[len(ranges) :]:
            axes.set_visible(False)
        for axes in panels[::across]:
            axes.set_ylabel(axis_label(header))
        return inline_svg(
            figure, f"{header} points", html_text(f"{name_and_unit(header)[0]} over what was drawn")
        )
