"""What the believed model expects of a plan, for its check and its printout."""

import numpy as np
from numpy.typing import NDArray

from rfca_rig.model.motion import ShaftMotion
from rfca_rig.model.parameters import RigModel
from rfca_rig.model.stroke import stroke_at_speed, stroke_following
from rfca_rig.protocol.plan import Hold, MoveShaft, Plan, SetHeight, Stage

Floats = NDArray[np.float64]

SAMPLE_S = 1e-3
SLOW_SAMPLE_S = 1e-2
HOLD_S = 0.5  # enough for the model to settle


def expected_force_N(plan: Plan, rig: RigModel) -> dict[Stage, float]:
    """Largest force (fy and fz together) that the model predicts in each recorded stage.

    A static sequence is followed at one height after the other, as the plan moves the shaft, so that a leg which wedges when
    it is pushed back is seen beforehand.
    """
    return {**_flaps(plan, rig), **_holds(plan, rig)}


def _flaps(plan: Plan, rig: RigModel) -> dict[Stage, float]:
    by_condition: dict[tuple[float, float], float] = {}
    for flap in plan.flaps:
        condition = (flap.height_m, flap.speed_rad_s)
        if condition not in by_condition:
            t_s = np.arange(0.0, flap.stroke_s, SAMPLE_S)
            stroke = stroke_at_speed(rig, flap.height_m, flap.speed_rad_s, t_s)
            by_condition[condition] = float(np.hypot(stroke.fy_N, stroke.fz_N).max())
    return {flap: by_condition[flap.height_m, flap.speed_rad_s] for flap in plan.flaps}


def _holds(plan: Plan, rig: RigModel) -> dict[Stage, float]:
    expected: dict[Stage, float] = {}
    for height_m, stages in _sequences(plan):
        expected.update(_along(height_m, stages, rig))
    return expected


def _sequences(plan: Plan) -> list[tuple[float, list[MoveShaft | Hold]]]:
    """Moves and holds between one setting of the rack and the next."""
    found: list[tuple[float, list[MoveShaft | Hold]]] = []
    for stage in plan.stages:
        if isinstance(stage, SetHeight):
            found.append((stage.height_m, []))
        elif found and isinstance(stage, MoveShaft | Hold):
            found[-1][1].append(stage)
    return [(height_m, stages) for height_m, stages in found if any(isinstance(stage, Hold) for stage in stages)]


def _along(height_m: float, stages: list[MoveShaft | Hold], rig: RigModel) -> dict[Stage, float]:
    """Follows the shaft through moves at their speeds and short holds; for each hold the largest force until its end."""
    angles, times = [rig.leg.start_angle_rad], [0.0]
    ends_s: dict[Stage, float] = {}
    for stage in stages:
        if isinstance(stage, MoveShaft):
            times.append(times[-1] + max(abs(stage.angle_rad - angles[-1]) / stage.speed_rad_s, SLOW_SAMPLE_S))
            angles.append(stage.angle_rad)
        else:
            times.append(times[-1] + HOLD_S)
            angles.append(angles[-1])
            ends_s[stage] = times[-1]
    t_s = np.arange(0.0, times[-1], SLOW_SAMPLE_S)
    held = stroke_following(rig, height_m, _polyline(np.array(times), np.array(angles)), t_s)
    force_N = np.hypot(held.fy_N, held.fz_N)
    return {stage: float(force_N[t_s <= end_s].max()) for stage, end_s in ends_s.items()}


def _polyline(times_s: Floats, angles_rad: Floats) -> ShaftMotion:
    speeds = np.diff(angles_rad) / np.diff(times_s)
    pieces = np.column_stack([angles_rad[:-1], speeds, np.zeros_like(speeds), np.zeros_like(speeds)])
    return ShaftMotion(times_s, pieces, times_s[:-1])
