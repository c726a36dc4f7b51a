"""What the believed model expects of a plan, for its check and its printout."""

import numpy as np
from numpy.typing import NDArray

from rfca_rig.model.motion import ShaftMotion
from rfca_rig.model.parameters import RigModel
from rfca_rig.model.stroke import SimulatedStroke, stroke_at_speed, stroke_following
from rfca_rig.protocol.check import Load
from rfca_rig.protocol.plan import Hold, MoveShaft, Plan, SetHeight, Stage, way_to

Floats = NDArray[np.float64]

SAMPLE_S = 1e-3
SLOW_SAMPLE_S = 1e-2
HOLD_S = 0.5  # enough for the model to settle


def expected_loads(plan: Plan, rig: RigModel) -> dict[Stage, Load]:
    """The load that the model predicts in each stroke, in each hold of a static sequence, and in its moves elsewhere.

    A static sequence is followed at one height after the other, as the plan moves the shaft, so that a leg which wedges when
    it is pushed back is seen beforehand. Which link ends touch is part of the model's solution. A hold's load is the largest on the
    way to it and at it.
    """
    return {**_flaps(plan, rig), **_holds(plan, rig)}


def _flaps(plan: Plan, rig: RigModel) -> dict[Stage, Load]:
    by_condition: dict[tuple[float, float], Load] = {}
    for flap in plan.flaps:
        condition = (flap.height_m, flap.speed_rad_s)
        if condition not in by_condition:
            t_s = np.arange(0.0, flap.stroke_s, SAMPLE_S)
            stroke = stroke_at_speed(rig, flap.height_m, flap.speed_rad_s, t_s)
            by_condition[condition] = _load(stroke, slice(None))
    return {flap: by_condition[flap.height_m, flap.speed_rad_s] for flap in plan.flaps}


def _holds(plan: Plan, rig: RigModel) -> dict[Stage, Load]:
    expected: dict[Stage, Load] = {}
    for height_m, stages in _sequences(plan):
        for stage, load in _along(height_m, stages, rig).items():
            expected[stage] = load.with_more(expected.get(stage, load))
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


def _along(height_m: float, stages: list[MoveShaft | Hold], rig: RigModel) -> dict[Stage, Load]:
    """Follows the shaft through moves at their speeds and short holds; the load of each hold with the way to it, and of other moves."""
    angles, times = [rig.leg.start_angle_rad], [0.0]
    for stage in stages:
        way_rad = way_to(stage.angle_rad, angles[-1], stage.forwards) if isinstance(stage, MoveShaft) else 0.0
        times.append(times[-1] + (max(abs(way_rad) / stage.speed_rad_s, SLOW_SAMPLE_S) if isinstance(stage, MoveShaft) else HOLD_S))
        angles.append(angles[-1] + way_rad)
    t_s = np.arange(0.0, times[-1], SLOW_SAMPLE_S)
    held = stroke_following(rig, height_m, _polyline(np.array(times), np.array(angles)), t_s)
    expected: dict[Stage, Load] = {}
    for place, (stage, begin_s, end_s) in enumerate(zip(stages, times, times[1:], strict=False)):
        load = _load(held, (t_s >= begin_s) & (t_s <= end_s))
        meant = _hold_after(stages[place:]) or stage
        expected[meant] = load.with_more(expected.get(meant, load))
    return expected


def _hold_after(stages: list[MoveShaft | Hold]) -> Hold | None:
    """The hold that the first of the stages is, or leads straight to."""
    return next((stage for stage in stages[:2] if isinstance(stage, Hold)), None)


def _load(stroke: SimulatedStroke, part: slice | NDArray[np.bool_]) -> Load:
    force_N = np.hypot(stroke.fy_N[part], stroke.fz_N[part])
    return Load(float(force_N.max(initial=0.0)), float(np.abs(stroke.tx_Nm[part]).max(initial=0.0)))


def _polyline(times_s: Floats, angles_rad: Floats) -> ShaftMotion:
    speeds = np.diff(angles_rad) / np.diff(times_s)
    pieces = np.column_stack([angles_rad[:-1], speeds, np.zeros_like(speeds), np.zeros_like(speeds)])
    return ShaftMotion(times_s, pieces, times_s[:-1])
