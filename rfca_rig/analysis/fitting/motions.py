"""Shaft motions to simulate: one for repeats that are alike, with the shaft as commanded, on average, or as recorded."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from rfca_rig.analysis.fitting.parameters import ModelPoint
from rfca_rig.analysis.matched_simulation import GRID_S, Shaft
from rfca_rig.analysis.repeats import Condition
from rfca_rig.analysis.shaft_speed import average_speed
from rfca_rig.model.motion import ShaftMotion, follow, ramp_to_speed
from rfca_rig.model.stroke import SimulatedStroke, simulate_stroke
from rfca_rig.recording.model import Stroke

Floats = NDArray[np.float64]

# Encoder noise of 1 mrad leaves this much after smoothing; it moves the touchdown of a stroke by 0.2 ms.
SAME_TURN_RAD = 5e-4


@dataclass(frozen=True)
class StrokeMotion:
    """One stroke to simulate: height, and a recorded motion of the shaft, or, where that is None, a ramp to `speed_rad_s`.

    `strokes_before` are those before each stroke of the condition, as in `model.setup.Setup`.
    """

    height_m: float
    speed_rad_s: float
    motion: ShaftMotion | None
    end_s: float
    strokes_before: tuple[int, ...] = ()

    def simulated(self, supposed: ModelPoint) -> SimulatedStroke:
        """Simulate the stroke on a grid of half milliseconds from the start. Raises SimulationFailed."""
        # Two samples beyond the end, so that interpolation at the last measured moment never leaves the grid.
        t_s = GRID_S * np.arange(0, int(np.ceil(self.end_s / GRID_S)) + 2, dtype=np.float64)
        return simulate_stroke(
            supposed.rig, self.height_m + supposed.height_offset_m, self._motion(supposed), t_s, None, self.strokes_before
        )

    def _motion(self, supposed: ModelPoint) -> ShaftMotion:
        if self.motion is None:
            leg, drive = supposed.rig.leg, supposed.rig.drive
            return ramp_to_speed(leg.start_angle_rad, self.speed_rad_s, drive.ramp_s, self.end_s)
        coefficients = self.motion.coefficients.copy()
        # Only the constant term of each polynomial piece shifts the angle.
        coefficients[:, 0] += supposed.turn_offset_rad
        return replace(self.motion, coefficients=coefficients)


def list_motions(condition: Condition, shaft: Shaft, ramp_s: float, end_s: float) -> tuple[tuple[StrokeMotion, ...], tuple[int, ...]]:
    """Shaft motions of a condition, each to `end_s`, and for each stroke the index of its motion.

    Parameters
    ----------
    condition
        Strokes of one height and speed.
    shaft
        As in `analysis.matched_simulation`. With "recorded", repeats whose smoothed turns differ by less than 0.5 mrad share one motion. A
        stroke without a recorded angle turns at its average speed.
    ramp_s
        Duration of the drive's ramp.
    end_s
        End of the simulation.
    """
    before = condition.strokes_before
    if shaft == "recorded":
        return _distinct([replace(_motion_of(stroke, ramp_s, end_s), strokes_before=before) for stroke in condition.strokes])
    speed_rad_s = condition.speed_rad_s
    if shaft == "average":
        speed_rad_s = float(np.mean([average_speed(stroke, ramp_s).speed_rad_s for stroke in condition.strokes]))
    return (StrokeMotion(condition.height_m, speed_rad_s, None, end_s, before),), (0,) * len(condition.strokes)


def mean_start_rad(strokes: Sequence[Stroke]) -> float | None:
    """Mean shaft angle before the start over all strokes that recorded it; None where no stroke did."""
    angles = [stroke.channel("shaft_angle_rad") for stroke in strokes]
    starts = [float(trace[1][trace[0] <= 0.0].mean()) for trace in angles if trace is not None and (trace[0] <= 0.0).any()]
    return float(np.mean(starts)) if starts else None


def _motion_of(stroke: Stroke, ramp_s: float, end_s: float) -> StrokeMotion:
    angle = stroke.channel("shaft_angle_rad")
    if angle is None:
        return StrokeMotion(stroke.height_m, average_speed(stroke, ramp_s).speed_rad_s, None, end_s)
    return StrokeMotion(stroke.height_m, stroke.speed_rad_s, follow(*angle), end_s)


def _distinct(turns: Sequence[StrokeMotion]) -> tuple[tuple[StrokeMotion, ...], tuple[int, ...]]:
    distinct: list[StrokeMotion] = []
    own: list[int] = []
    for turn in turns:
        alike = next((i for i, other in enumerate(distinct) if _same(turn, other)), len(distinct))
        if alike == len(distinct):
            distinct.append(turn)
        own.append(alike)
    return tuple(distinct), tuple(own)


def _same(turn: StrokeMotion, other: StrokeMotion) -> bool:
    if turn.motion is None or other.motion is None:
        return turn == other
    t_s = np.linspace(0.0, turn.end_s, 200)
    return float(np.abs(turn.motion.angle_rad(t_s) - other.motion.angle_rad(t_s)).max()) < SAME_TURN_RAD
