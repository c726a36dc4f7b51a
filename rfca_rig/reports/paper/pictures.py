"""Fig. 7 (a) to (f) of the paper for one leg, and the numbers behind them as CSV.

(a) is the contact force of the model and of MuJoCo, (b) torque over rotation of a hinge. From (c)
on each figure is a condition: the whole stroke, and the surroundings of its valley enlarged.
"""

from collections.abc import Iterable

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from rfca_rig.analysis.compare import ComparedCondition
from rfca_rig.analysis.crosscheck import CheckedCondition
from rfca_rig.analysis.matched_simulation import MatchedSimulation
from rfca_rig.analysis.phases import Valley
from rfca_rig.analysis.reproduction import ReproducedCondition
from rfca_rig.analysis.torque_rotation.static_result import StaticResult
from rfca_rig.analysis.valley_uncertainty import PredictedValley
from rfca_rig.escaping import csv_line
from rfca_rig.reports.static.pictures import DASHES, draw_torque_curve
from rfca_rig.reports.strokes.overlay import COLUMNS, draw_crosscheck, draw_force
from rfca_rig.reports.strokes.traces import trace_csv
from rfca_rig.reports.style import MEASURED, OTHER, SIMULATED, SMALL, envelope

Floats = NDArray[np.float64]

SIZE_IN = (4.9, 4.4)
STROKE_BOX = (0.125, 0.515, 0.86, 0.4)
VALLEY_BOX = (0.125, 0.105, 0.86, 0.3)
CURVE_IN = (4.9, 3.7)
CURVE_BOX = (0.125, 0.135, 0.86, 0.835)
CHECK_IN = (4.9, 3.7)
# Half of the time around the measured valley that is enlarged.
AROUND_VALLEY_S = 0.12


def make_curve_figure(static: StaticResult) -> Figure:
    """Fig. 7 (b): torque over rotation of a hinge with its 95 % band."""
    figure = Figure(figsize=CURVE_IN)
    axes = figure.add_axes(CURVE_BOX)
    draw_torque_curve(axes, static)
    axes.set_xlabel("rotation of the hinge (degrees)")
    return figure


def make_check_figure(checked: CheckedCondition) -> Figure:
    """Fig. 7 (a): contact force of the model and of MuJoCo, and their difference."""
    figure = Figure(figsize=CHECK_IN, layout="constrained")
    force, difference = figure.subplots(2, 1, sharex=True, height_ratios=(2.2, 1.0))
    draw_crosscheck(force, difference, checked)
    force.set_ylabel("contact force (N)")
    force.legend(frameon=False, fontsize=SMALL)
    difference.set_ylabel("difference (N)")
    return figure


def make_stroke_figure(shown: ReproducedCondition) -> Figure:
    """Fig. 7 (c) to (f): every repeat over the model with its shaft at the average speed, as in the
    paper, and along the recorded shaft. Below, the valley with the predicted 95 % interval.
    """
    average = shown.average
    figure = Figure(figsize=SIZE_IN)
    stroke = figure.add_axes(STROKE_BOX)
    draw_force(stroke, average, average.end_s, COLUMNS)
    _draw_recorded(stroke, shown.recorded.simulated)
    stroke.set_xlim(0.0, average.end_s)
    _draw_valley(figure.add_axes(VALLEY_BOX), shown)
    return figure


def _draw_recorded(axes: Axes, simulated: Iterable[MatchedSimulation]) -> None:
    for model in simulated:
        axes.plot(
            *envelope(model.stroke.t_s, model.stroke.fz_N, COLUMNS),
            color=OTHER,
            lw=0.9,
            ls=DASHES["other"],
        )


def _draw_valley(axes: Axes, shown: ReproducedCondition) -> None:
    """The surroundings of the valley, and the box within which its measured mean is expected."""
    axes.set_xlabel("time from the start of the motion (s)")
    axes.set_ylabel("fz (N)")
    middle_s = _middle_of_valley_s(shown.average)
    if middle_s is None:
        return
    limits_s = (middle_s - AROUND_VALLEY_S, middle_s + AROUND_VALLEY_S)
    lows = []
    for model in shown.average.simulated:
        lows.append(
            _plot_within(axes, model.stroke.t_s, model.stroke.fz_N, limits_s, SIMULATED, 2.8)
        )
    for repeat in shown.average.repeats:
        if len(repeat.t_s):
            lows.append(_plot_within(axes, repeat.t_s, repeat.fz_N, limits_s, MEASURED, 0.55))
    for model in shown.recorded.simulated:
        lows.append(
            _plot_within(
                axes, model.stroke.t_s, model.stroke.fz_N, limits_s, OTHER, 0.9, is_dashed=True
            )
        )
    corners = _box_of(shown.valley)
    if corners is not None:
        (left_s, right_s), (low_N, high_N) = corners
        axes.fill_between([left_s, right_s], low_N, high_N, color=OTHER, alpha=0.18, lw=0)
        axes.plot(
            [left_s, right_s, right_s, left_s, left_s],
            [low_N, low_N, high_N, high_N, low_N],
            color=OTHER,
            lw=0.8,
        )
        lows.append(low_N)
    row = shown.valley.row
    if row.time.mean is not None and row.fz.mean is not None:
        axes.plot(row.time.mean, row.fz.mean, ls="", marker="o", mfc="none", mec=MEASURED, ms=7.0)
    deepest_N = min(lows)
    axes.set_xlim(*limits_s)
    # The lower third of the force: the valley in full, what rises to its sides cut at the frame.
    axes.set_ylim(1.03 * deepest_N, 0.66 * deepest_N)


def _plot_within(
    axes: Axes,
    t_s: Floats,
    fz_N: Floats,
    limits_s: tuple[float, float],
    colour: str,
    width: float,
    is_dashed: bool = False,
) -> float:
    """Draws the part of a line within the limits, and returns its lowest value."""
    inside = (t_s >= limits_s[0]) & (t_s <= limits_s[1])
    if not inside.any():
        return 0.0
    axes.plot(
        *envelope(t_s[inside], fz_N[inside], COLUMNS),
        color=colour,
        lw=width,
        ls=DASHES["other"] if is_dashed else "-",
        solid_capstyle="round",
    )
    return float(fz_N[inside].min())


def _middle_of_valley_s(compared: ComparedCondition) -> float | None:
    """Mean time of the measured valleys, or of the simulated ones where none was measured."""
    for candidates in (compared.repeats, compared.simulated):
        times_s = [one.valley.time_s for one in candidates if isinstance(one.valley, Valley)]
        if times_s:
            return float(np.mean(times_s))
    return None


def _box_of(valley: PredictedValley) -> tuple[tuple[float, float], tuple[float, float]] | None:
    """Borders of the predicted intervals in time and force."""
    time = valley.time
    fz = valley.fz
    if time.predicted is None or fz.predicted is None:
        return None
    if time.half_95 is None or fz.half_95 is None:
        return None
    return (
        (time.predicted - time.half_95, time.predicted + time.half_95),
        (fz.predicted - fz.half_95, fz.predicted + fz.half_95),
    )


def stroke_csv(shown: ReproducedCondition) -> str:
    """fz of the figure over time: each repeat, the model with its shaft at the average speed, and
    the model along the recorded shaft of each repeat.
    """
    along_shaft = {}
    for repeat, model in zip(shown.recorded.repeats, shown.recorded.simulated, strict=True):
        along_shaft[f"along_shaft_{repeat.repeat}_fz_N"] = model
    return trace_csv(shown.average, along_shaft)


def check_csv(checked: Iterable[CheckedCondition]) -> str:
    """Contact force of the model and of MuJoCo over time, condition by condition."""
    lines = [csv_line(("height_mm", "speed_rad_s", "t_s", "model_N", "mujoco_N"))]
    for condition in checked:
        height_mm = f"{1e3 * condition.condition.height_m:g}"
        speed_rad_s = f"{condition.condition.speed_rad_s:g}"
        forces = zip(
            condition.ours.t_s, condition.contact_N, condition.theirs.normal_N, strict=True
        )
        for t_s, model_N, mujoco_N in forces:
            lines.append(
                csv_line(
                    (height_mm, speed_rad_s, f"{t_s:.4f}", f"{model_N:.6g}", f"{mujoco_N:.6g}")
                )
            )
    return "".join(lines)
