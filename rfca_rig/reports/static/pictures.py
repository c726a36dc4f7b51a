"""Figures of the static experiment: torque over rotation and its derivative, residuals of single
angles, and the shape under a tip force.

The first are in the manner of the paper's Fig. 7 (b).
"""

from collections.abc import Callable, Sequence
from pathlib import Path

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from rfca_rig.analysis.static_forces import LoadedShape
from rfca_rig.analysis.torque_rotation.bases import TorqueCurve
from rfca_rig.analysis.torque_rotation.static_result import PredictedHingeCurve, StaticResult
from rfca_rig.reports.style import (
    BAD,
    FAINT,
    MEASURED,
    NARROW_IN,
    OTHER,
    PAPER,
    SIMULATED,
    SIMULATED_EDGE,
    SMALL,
    check_picture_path,
    drawing,
    for_both_widths,
    inline_svg,
    save_picture,
)

Floats = NDArray[np.float64]

SIZE_IN = (4.9, 3.7)
LOW_IN = (10.0, 2.3)
NARROW_LOW_IN = (NARROW_IN, 2.3)
BOX = (0.125, 0.135, 0.86, 0.835)
LOW_BOX = (0.075, 0.215, 0.916, 0.735)
NARROW_LOW_BOX = (0.17, 0.215, 0.8, 0.735)
DASHES: dict[str, tuple[int, tuple[float, ...]]] = {
    "other": (0, (3.2, 1.8)),
    "link": (0, (1.0, 1.6)),
    "held": (0, (6.0, 2.0)),
    "k0": (0, (2.0, 1.2)),
}
ELASTICA_STYLES = ("held", "link", "k0")

WIDTH_IN = 4.6
# Length of the force's arrow, as a share of the leg.
ARROW = 0.3


def draw_torque(result: StaticResult, elastica: Sequence[PredictedHingeCurve]) -> str:
    """Torque over rotation: measured points, curve with band, the other form (law or spline)
    dashed, elastica thin.
    """

    def draw(axes: Axes) -> None:
        _draw_elastica(axes, elastica, lambda prediction: prediction.torque_Nm)
        draw_torque_curve(axes, result)

    return _draw_figure(
        draw,
        SIZE_IN,
        BOX,
        "torque",
        "torque of a hinge over its rotation, measured points, curve with band, elastica",
    )


def draw_torque_curve(axes: Axes, result: StaticResult) -> None:
    """Draws measured points and the curve with its band, as in the paper's Fig. 7 (b); the other
    form, law or spline, dashed.
    """
    _draw_curve(axes, result.curve, result.curve.torque_Nm, flips=True)
    other = result.other_curve
    grid = other.grid_rad()
    axes.plot(
        _deg(other, grid),
        other.bends * other.torque_Nm(grid)[0],
        color=OTHER,
        lw=1.0,
        ls=DASHES["other"],
    )
    curve = result.curve
    points = result.points
    known = np.isfinite(points.phi_rad)
    x = _deg(curve, points.phi_rad[known])
    y = curve.bends * points.torque_Nm[known]
    dx = np.degrees(points.phi_std_rad[known])
    dy = points.torque_std_Nm[known]
    axes.hlines(y, x - dx, x + dx, color=MEASURED, lw=0.5, alpha=0.6)
    axes.vlines(x, y - dy, y + dy, color=MEASURED, lw=0.5, alpha=0.6)
    _dots(axes, x, y, points.turned[known] < 0)
    axes.set_ylim(*_limits(result))
    axes.set_ylabel("torque of a hinge (N m)")


def draw_stiffness(result: StaticResult, elastica: Sequence[PredictedHingeCurve]) -> str:
    """Stiffness over rotation: derivative of the curve with its band, the other form dashed,
    elastica thin.
    """

    def draw(axes: Axes) -> None:
        _draw_elastica(axes, elastica, lambda prediction: prediction.stiffness_Nm_per_rad)
        _draw_curve(axes, result.curve, result.curve.stiffness_Nm_per_rad, flips=False)
        other = result.other_curve
        grid = other.grid_rad()
        axes.plot(
            _deg(other, grid),
            other.stiffness_Nm_per_rad(grid)[0],
            color=OTHER,
            lw=1.0,
            ls=DASHES["other"],
        )
        axes.set_ylim(bottom=0.0)
        axes.set_ylabel("equivalent stiffness (N m/rad)")

    return _draw_figure(
        draw,
        SIZE_IN,
        BOX,
        "stiffness",
        "equivalent stiffness of a hinge over its rotation, with band",
    )


@for_both_widths
def draw_residuals(result: StaticResult, is_narrow: bool) -> str:
    """Residual torque of every angle in N m, with its error from angle and forces together."""
    curve = result.curve
    points = result.points

    def draw(axes: Axes) -> None:
        phi = points.phi_rad.ravel()
        known = np.isfinite(phi)
        phi = phi[known]
        off = curve.bends * (points.torque_Nm.ravel()[known] - curve.torque_Nm(phi)[0])
        # An error of the angle shifts the curve's torque by stiffness times that error; it adds in
        # quadrature to that of the forces.
        std = np.hypot(
            points.torque_std_Nm.ravel()[known],
            curve.stiffness_Nm_per_rad(phi)[0] * points.phi_std_rad.ravel()[known],
        )
        x = _deg(curve, phi)
        back = points.turned.ravel()[known] < 0
        grid = curve.grid_rad()
        band = curve.reach * curve.torque_Nm(grid)[1]
        axes.fill_between(_deg(curve, grid), -band, band, color=SIMULATED, alpha=0.55, lw=0)
        axes.axhline(0.0, color=SIMULATED, lw=1.4)
        if result.loop is not None and result.loop.seen:
            for half_Nm in (-result.loop.half_Nm, result.loop.half_Nm):
                axes.axhline(half_Nm, color=SIMULATED_EDGE, lw=0.7, ls=DASHES["k0"])
        axes.vlines(x, off - std, off + std, color=MEASURED, lw=0.5, alpha=0.6)
        _dots(axes, x, off, back)
        axes.set_xlim(left=0.0)
        axes.set_ylabel("off the curve (N m)")

    if is_narrow:
        size_in = NARROW_LOW_IN
        box = NARROW_LOW_BOX
    else:
        size_in = LOW_IN
        box = LOW_BOX
    return _draw_figure(
        draw, size_in, box, f"rest {is_narrow}", "measured torques less the curve, over rotation"
    )


def _draw_figure(
    draw: Callable[[Axes], None],
    size_in: tuple[float, float],
    box: tuple[float, float, float, float],
    salt: str,
    label: str,
) -> str:
    with drawing():
        figure = Figure(figsize=size_in)
        axes = figure.add_axes(box)
        draw(axes)
        axes.set_xlabel("rotation of the hinge (degrees)")
        return inline_svg(figure, f"static {salt}", label)


def _deg(curve: TorqueCurve, phi_rad: Floats) -> Floats:
    return np.asarray(np.degrees(curve.bends * phi_rad))


def _draw_curve(
    axes: Axes, curve: TorqueCurve, of: Callable[[Floats], tuple[Floats, Floats]], *, flips: bool
) -> None:
    grid = curve.grid_rad()
    value, std = of(grid)
    if flips:
        value = value * curve.bends
    x = _deg(curve, grid)
    axes.fill_between(
        x, value - curve.reach * std, value + curve.reach * std, color=SIMULATED, alpha=0.55, lw=0
    )
    axes.plot(x, value, color=SIMULATED, lw=2.4, solid_capstyle="round")
    axes.set_xlim(min(0.0, float(x.min())), float(x.max()) * 1.02)


def _draw_elastica(
    axes: Axes, elastica: Sequence[PredictedHingeCurve], of: Callable[[PredictedHingeCurve], Floats]
) -> None:
    for prediction, style in zip(elastica, ELASTICA_STYLES, strict=False):
        axes.plot(
            np.degrees(prediction.phi_rad), of(prediction), color=FAINT, lw=1.0, ls=DASHES[style]
        )


def _dots(axes: Axes, x: Floats, y: Floats, back: NDArray[np.bool_]) -> None:
    """Points (k,) over rotation (k,) in deg; hollow where `back` (k,) states that the hinge had
    turned back.
    """
    axes.plot(x[~back], y[~back], ls="", marker="o", ms=2.6, mfc=MEASURED, mec=MEASURED, mew=0.5)
    axes.plot(x[back], y[back], ls="", marker="o", ms=4.2, mfc=PAPER, mec=MEASURED, mew=0.8)


def _limits(result: StaticResult) -> tuple[float, float]:
    """Limits of the torque axis: all measured points, whatever the elastica predicts."""
    torque = result.curve.bends * result.points.torque_Nm[np.isfinite(result.points.torque_Nm)]
    low = min(0.0, float(torque.min()))
    high = float(torque.max())
    return low - 0.02 * (high - low), high + 0.07 * (high - low)


def write_tip_load_picture(shape: LoadedShape, path: Path) -> None:
    """Writes a picture of the shape to `path`, whose ending decides the format. Raises BadInput
    where that fails.
    """
    check_picture_path(path)
    ends = shape.ends_mm
    alone = shape.unloaded_mm
    length = float(np.hypot(*np.diff(ends, axis=0).T).sum())
    # The bound avoids a division by zero for no force, where no arrow is drawn.
    arrow = ARROW * length * shape.force_N / max(float(np.hypot(*shape.force_N)), 1e-12)
    visible = np.vstack([ends, alone, ends[-1:] - arrow])
    low = visible.min(axis=0) - 0.09 * length
    high = visible.max(axis=0) + 0.09 * length
    with drawing():
        mpl.rcParams.update({"svg.hashsalt": "tip load", "svg.fonttype": "none"})
        figure = Figure(
            figsize=(WIDTH_IN, WIDTH_IN * (high[1] - low[1]) / (high[0] - low[0]) + 0.7),
            layout="constrained",
        )
        axes = figure.subplots()
        axes.plot(*alone.T, "--", color=FAINT, lw=1.2, label="weight alone")
        axes.plot(*ends.T, "o-", color=SIMULATED, lw=2.8, ms=4.5, label="under the force")
        for torque, point, before, after in zip(
            shape.torques_Nm[1:], ends[1:-1], ends[:-2], ends[2:], strict=True
        ):
            # Numbers are placed beside the leg: perpendicular to the line between the neighbouring
            # points.
            across = np.array([before[1] - after[1], after[0] - before[0]])
            away = point - 0.055 * length * across / np.hypot(*across)
            axes.text(
                float(away[0]),
                float(away[1]),
                f"{torque:.2f}",
                ha="center",
                va="center",
                fontsize=SMALL,
            )
        if shape.force_N.any():
            axes.annotate(
                "",
                xy=tuple(ends[-1]),
                xytext=tuple(ends[-1] - arrow),
                arrowprops={"arrowstyle": "-|>", "color": BAD, "lw": 1.6},
            )
            axes.plot([], [], color=BAD, lw=1.6, label=f"{np.hypot(*shape.force_N):.3g} N")
        axes.set_aspect("equal")
        # y counts downwards, as in the model.
        axes.set(
            xlim=(low[0], high[0]), ylim=(high[1], low[1]), xlabel="along (mm)", ylabel="down (mm)"
        )
        axes.set_title("torques of the hinges in N m", fontsize=SMALL, loc="left")
        axes.legend(frameon=False, fontsize=SMALL)
        save_picture(figure, path)
