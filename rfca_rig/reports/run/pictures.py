"""Figures of a run: a small trace of every stroke, static forces over the shaft angle, peaks and
stiffness over cycles.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from itertools import pairwise

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator
from numpy.typing import NDArray

from rfca_rig.engine.loop_gaps import bin_end_ms
from rfca_rig.errors import SimulationFailed
from rfca_rig.escaping import html_text
from rfca_rig.model.parameters import RigModel
from rfca_rig.model.stroke import simulate_stroke_at_speed
from rfca_rig.recording.loop_gaps import RecordedGaps
from rfca_rig.recording.model import Recording, StaticStage
from rfca_rig.recording.tables import cycle_table
from rfca_rig.reports.run.parts import RunPart, RunStory
from rfca_rig.reports.style import (
    BAD,
    FAINT,
    MEASURED,
    NARROW_IN,
    PAPER,
    SIMULATED,
    Panel,
    drawing,
    envelope,
    for_both_widths,
    hover_values,
    inline_svg,
    make_panel,
)
from rfca_rig.reports.table import Table
from rfca_rig.reports.text import in_thousands

Floats = NDArray[np.float64]

# Limits that keep the page readable and small.
MOST_TRACES = 40
MOST_STAGES = 60
TRACE_IN = (2.9, 1.55)
TRACE_HOVERS = 12
# Resolution of lines, two points for each column: of a small panel, and of a figure across the
# page.
TRACE_COLUMNS = 60
CYCLE_COLUMNS = 300
# Sampling of simulated strokes, fine enough for a small panel.
SAMPLE_S = 2e-3
# Sizes, and margins on the left, below and above, of a figure across the page and on a narrow
# screen.
WIDE_IN = (8.6, 2.5)
LOW_IN = (NARROW_IN, 2.2)
MOST_TICKS = 10
MARGINS_IN = (0.69, 0.48, 0.18)
DASHES: tuple[str | tuple[int, tuple[float, ...]], ...] = (
    "-",
    (0, (4.0, 2.0)),
    (0, (1.0, 1.5)),
    "-.",
)
# Limits of the axes of the gaps: room for the label of 1000 ms; one tick is seen above the least
# number.
FIRST_GAP_MS = 0.1
LAST_GAP_MS = 1600.0
LEAST_TICKS = 0.7
FORCES = {"fy_N": "fy (N)", "fz_N": "fz (N)", "tx_Nm": "tx (N m)"}


def select_traces(parts: Sequence[RunPart]) -> list[RunPart]:
    """Parts with a trace; of too many, those cut short and others evenly over the run."""
    with_trace = [part for part in parts if part.trace is not None]
    if len(with_trace) <= MOST_TRACES:
        return with_trace
    evenly = {round(position) for position in np.linspace(0, len(with_trace) - 1, MOST_TRACES)}
    return [part for index, part in enumerate(with_trace) if index in evenly or part.ended]


def draw_traces(parts: Sequence[RunPart], rig: RigModel | None) -> list[Panel]:
    """fz over time, each stroke in its own panel on one scale, over the stroke that the model
    predicts for the commanded motion.
    """
    traces = [(part, part.trace) for part in parts if part.trace is not None]
    last_s = max((float(trace.t_s[-1]) for _, trace in traces), default=1.0)
    first_s = min((float(trace.t_s[0]) for _, trace in traces), default=0.0)
    panels: list[Panel] = []
    limits_N = (np.inf, -np.inf)
    with drawing():
        drawn = []
        for part, trace in traces:
            figure, axes = make_panel("fz (N)", "time (s)", TRACE_IN)
            # Height in m and speed in rad/s from the label of a stroke; None for another label.
            words = part.label.replace(",", "").split()
            if words[:1] == ["flap"]:
                condition = (1e-3 * float(words[1]), float(words[3]))
            else:
                condition = None
            if rig is None or condition is None:
                expected = None
            else:
                expected = _predict_stroke(rig, *condition, round(float(trace.t_s[-1]), 2))
            values = {"measured": trace.fz_N}
            if expected is not None:
                axes.plot(
                    *envelope(*expected, TRACE_COLUMNS),
                    color=SIMULATED,
                    lw=1.9,
                    solid_capstyle="round",
                )
                values["expected"] = np.interp(trace.t_s, *expected, left=np.nan, right=np.nan)
            axes.plot(*envelope(trace.t_s, trace.fz_N, TRACE_COLUMNS), color=MEASURED, lw=0.8)
            axes.margins(x=0.0, y=0.06)
            low, high = axes.get_ylim()
            limits_N = (min(low, limits_N[0]), max(high, limits_N[1]))
            drawn.append(
                (part, figure, axes, hover_values(axes, trace.t_s, "s", values, "N", TRACE_HOVERS))
            )
        for part, figure, axes, hovers in drawn:
            axes.set_xlim(first_s, last_s)
            axes.set_ylim(limits_N)
            title = part.label.removeprefix("flap ").replace(", repeat ", ", no. ")
            if part.ended:
                title += " ✗"
            label = html_text(f"fz over time, {title}, measured and expected")
            panels.append(
                Panel(
                    title,
                    inline_svg(figure, f"trace {len(panels)}", label, hovers),
                    ended=bool(part.ended),
                )
            )
    return panels


# Repeats of a condition share one simulation; the end is rounded to 10 ms by the caller so that
# they find it.
@cache
def _predict_stroke(
    rig: RigModel, height_m: float, speed_rad_s: float, end_s: float
) -> tuple[Floats, Floats] | None:
    try:
        simulation = simulate_stroke_at_speed(
            rig, height_m, speed_rad_s, np.arange(-0.1, end_s, SAMPLE_S)
        )
    except SimulationFailed:
        return None
    return simulation.t_s, simulation.fz_N


def select_static_stages(stages: Sequence[StaticStage]) -> list[StaticStage]:
    """All static stages, or, of too many, complete loading sequences evenly over the run with
    the first and the last.
    """
    if len(stages) <= MOST_STAGES:
        return list(stages)
    pieces = np.split(np.arange(len(stages)), _sequence_starts(stages))
    count = max(2, MOST_STAGES * len(pieces) // len(stages))
    chosen = sorted({round(position) for position in np.linspace(0, len(pieces) - 1, count)})
    return [stages[index] for number in chosen for index in pieces[number]]


def draw_static_forces(stages: Sequence[StaticStage]) -> list[Panel]:
    """Means over the shaft angle, a panel for each force and a line for each height; hollow
    markers for unloading.
    """
    heights = sorted({stage.height_m for stage in stages})
    panels: list[Panel] = []
    with drawing():
        for name, words in FORCES.items():
            figure, axes = make_panel(words, "shaft (degrees)", TRACE_IN)
            for height_m, dashes in zip(heights, DASHES, strict=False):
                _static(
                    axes, [stage for stage in stages if stage.height_m == height_m], name, dashes
                )
            panels.append(
                Panel(
                    "",
                    inline_svg(
                        figure,
                        f"static {name}",
                        f"{words} over the angle of the shaft, at each height",
                    ),
                )
            )
    return panels


def _static(
    axes: Axes,
    stages: Sequence[StaticStage],
    name: str,
    dashes: str | tuple[int, tuple[float, ...]],
) -> None:
    x = np.degrees([stage.shaft_angle_rad for stage in stages])
    y = np.array([getattr(stage, name) for stage in stages])
    std = np.array([stage.std.get(name, 0.0) for stage in stages])
    for piece in np.split(np.arange(len(x)), _sequence_starts(stages)):
        axes.plot(x[piece], y[piece], color=MEASURED, lw=0.7, ls=dashes)
    axes.vlines(x, y - std, y + std, color=MEASURED, lw=0.6)
    for direction, face in (("loading", MEASURED), ("unloading", PAPER)):
        of_it = np.array([stage.direction == direction for stage in stages], dtype=bool)
        axes.plot(x[of_it], y[of_it], ls="", marker="o", ms=3.0, mfc=face, mec=MEASURED, mew=0.7)


def _sequence_starts(stages: Sequence[StaticStage]) -> list[int]:
    """Indices at which the shaft has returned to a smaller angle to load the leg again."""
    pairs = enumerate(pairwise(stages), start=1)
    return [
        index
        for index, (a, b) in pairs
        if b.direction == "loading" and b.shaft_angle_rad < a.shaft_angle_rad
    ]


@for_both_widths
def draw_cycles(story: RunStory, is_narrow: bool) -> str:
    """Largest force and smallest fz of each cycle over its number, with the force that the model
    predicts.
    """
    cycles = cycle_table(story.recording)
    order = np.argsort(cycles.numbers, kind="stable")
    numbers = cycles.numbers[order].astype(float)
    expected = next(
        (part.expected for part in story.parts if part.kind == "cycles" and part.expected), None
    )
    columns = CYCLE_COLUMNS
    if is_narrow:
        columns //= 2
    with drawing():
        figure, axes = _make_figure(is_narrow)
        if expected is not None:
            axes.axhline(expected.force_N, color=SIMULATED, lw=2.2)
        for values, dashes in (
            (cycles.peak_force_N[order], "-"),
            (cycles.min_fz_N[order], (0, (3, 1.5))),
        ):
            axes.plot(
                *envelope(numbers, values, columns),
                color=MEASURED,
                lw=0.8,
                ls=dashes,
            )
        axes.set_xlabel("cycle")
        axes.set_ylabel("force (N)")
        axes.margins(x=0.0, y=0.08)
        _count_below(axes, is_narrow)
        return inline_svg(
            figure,
            f"cycles {is_narrow}",
            "largest force and least fz of each cycle over its number",
        )


@dataclass(frozen=True)
class GapPicture:
    """The gaps, and between which gaps in ms a tick is too late, by its period; None where no limit
    is recorded.
    """

    gaps: RecordedGaps
    late_ms: tuple[float, float] | None


@for_both_widths
def draw_gaps(picture: GapPicture, is_narrow: bool) -> str:
    """Number of ticks over the gap before them, with the watchdog and the limit of a late loop."""
    gaps = picture.gaps
    with drawing():
        figure, axes = _make_figure(is_narrow)
        axes.set_xscale("log")
        axes.set_yscale("log")
        for edge_ms, count in gaps.histogram.ticks_by_edge_ms.items():
            # The first bin begins at 0, the last has no end; neither is on a logarithmic scale.
            left_ms = max(edge_ms, 0.5 * FIRST_GAP_MS)
            right_ms = bin_end_ms(edge_ms) or 2.0 * LAST_GAP_MS
            axes.fill_between([left_ms, right_ms], LEAST_TICKS, count, color=MEASURED, lw=0.4)
        if picture.late_ms is not None:
            axes.axvspan(*picture.late_ms, color=SIMULATED, lw=0.8)
        if gaps.watchdog_ms is not None:
            axes.axvline(gaps.watchdog_ms, color=BAD, lw=1.4)
        axes.set_xlim(FIRST_GAP_MS, LAST_GAP_MS)
        axes.set_ylim(bottom=LEAST_TICKS)
        axes.xaxis.set_major_formatter(lambda value, _: f"{value:g}")
        axes.yaxis.set_major_formatter(lambda value, _: in_thousands(f"{value:.0f}"))
        axes.minorticks_off()
        axes.set_xlabel("gap (ms)")
        axes.set_ylabel("ticks")
        return inline_svg(figure, f"gaps {is_narrow}", f"ticks over their gaps: {gaps.text()}")


def _read_numbers(table: Table, key: str) -> Floats:
    """The column (rows,) of a table."""
    return np.array([float(str(row.values[key])) for row in table.rows])


@for_both_widths
def draw_checks(checks: Table, is_narrow: bool) -> str:
    """Drift of the stiffness with its interval over the number of cycles before each check,
    between the limits.
    """
    x = _read_numbers(checks, "cycles")
    drift = _read_numbers(checks, "drift_pct")
    half = _read_numbers(checks, "half_pct")
    limit = float(_read_numbers(checks, "limit_pct").max())
    with drawing():
        figure, axes = _make_figure(is_narrow)
        axes.axhline(0.0, color=FAINT, lw=0.6)
        for side in (-limit, limit):
            axes.axhline(side, color=BAD, lw=0.9, ls=(0, (5, 2)))
        axes.vlines(x, drift - half, drift + half, color=MEASURED, lw=0.9)
        axes.plot(x, drift, color=MEASURED, lw=0.6, marker="o", ms=3.5)
        axes.set_xlim(0.0, 1.04 * float(x.max()))
        _count_below(axes, is_narrow)
        axes.set_xlabel("cycles")
        axes.set_ylabel("drift (%)")
        return inline_svg(
            figure, f"checks {is_narrow}", "drift of the stiffness over cycles, between its limits"
        )


def _make_figure(is_narrow: bool) -> tuple[Figure, Axes]:
    (wide, high) = LOW_IN if is_narrow else WIDE_IN
    (left, below, above) = MARGINS_IN
    figure = Figure(figsize=(wide, high))
    return figure, figure.add_axes(
        (left / wide, below / high, (wide - left - 0.1) / wide, (high - below - above) / high)
    )


def _count_below(axes: Axes, is_narrow: bool) -> None:
    """Labels the x axis with whole numbers, grouped by thousands."""
    ticks = MOST_TICKS
    if is_narrow:
        ticks //= 2
    axes.xaxis.set_major_locator(MaxNLocator(integer=True, nbins=ticks))
    axes.xaxis.set_major_formatter(lambda value, _: in_thousands(f"{value:.0f}"))


def has_cycles(recording: Recording) -> bool:
    """Whether the recording holds cycles of a fatigue run."""
    return len(cycle_table(recording).numbers) > 0
