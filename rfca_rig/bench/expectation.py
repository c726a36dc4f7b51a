"""Loads that the nominal model predicts: for a plan, its check and its printout, and for whole
turns of the shaft.

Whole turns are cycles, and the way home after a stop.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from rfca_rig.errors import BadInput
from rfca_rig.model.motion import ShaftMotion
from rfca_rig.model.parameters import RigModel
from rfca_rig.model.stroke import SimulatedStroke, simulate_stroke, simulate_stroke_at_speed
from rfca_rig.protocol.check import Load
from rfca_rig.protocol.plan import (
    TURN_RAD,
    Approach,
    Cycles,
    Flap,
    Hold,
    MoveShaft,
    Plan,
    SetHeight,
    Stage,
    turn_to,
)

SAMPLE_S = 1e-3

Floats = NDArray[np.float64]

# Height, and the moves; None stands for a hold.
Motion = tuple[float, tuple[MoveShaft | None, ...]]
# Index of a stage in its sequence, and its load.
Loads = list[tuple[int, Load]]
SLOW_SAMPLE_S = 1e-2
# Simulated duration of a hold: enough for the model to settle.
HOLD_S = 0.5
# The lowest angle that a rig file may give for a parked leg.
PARKED_UPRIGHT_DEG = -90


def check_parked_leg(plan: Plan, rig: RigModel, parked_angle_rad: float) -> None:
    """Raises BadInput where the leg, parked without torque while the rack moves, would reach the
    plate at a height of the plan.

    A leg that stands on the plate is pushed back to its start angle by the first move, and wedges.
    """
    height_m = min(
        (stage.height_m for stage in plan.stages if isinstance(stage, SetHeight)), default=math.inf
    )
    reach_m = predict_reach(rig, parked_angle_rad)
    if reach_m < height_m:
        return
    parked_deg = round(math.degrees(parked_angle_rad), 1)
    clear_deg = math.ceil(parked_deg) - 1
    while (
        clear_deg > PARKED_UPRIGHT_DEG and predict_reach(rig, math.radians(clear_deg)) >= height_m
    ):
        clear_deg -= 1
    raise BadInput(
        f"{plan.title}: the leg parked at {parked_deg:g} deg hangs {1e3 * reach_m:.0f} mm "
        "below the shaft and reaches the plate, which is "
        f"{1e3 * height_m:.1f} mm below it; set [rig] parked_angle_deg in the rig file to "
        f"{clear_deg} or less, or raise the rack"
    )


def predict_reach(rig: RigModel, shaft_angle_rad: float) -> float:
    """How far the lowest link end of a leg that hangs in the air is below the shaft, in m."""
    lengths_m = np.array(rig.leg.link_lengths_m)
    times_s = np.array([0.0, HOLD_S])
    standing = ShaftMotion(times_s, np.array([[shaft_angle_rad, 0.0, 0.0, 0.0]]), times_s[:1])
    # Above any plate, and without what only moves or measures.
    hanging = simulate_stroke(
        replace(rig, effects=(), swing=None), 2.0 * float(lengths_m.sum()), standing, times_s[:1]
    )
    ends_m = np.cumsum(lengths_m * np.sin(hanging.q_rad[0]))
    return float(ends_m.max()) + rig.leg.link_radius_m


@dataclass(frozen=True)
class Bending:
    """The largest angle between the last link and the first in one turn, and the shaft angle
    there; in rad.
    """

    bending_rad: float
    shaft_rad: float

    def text(self) -> str:
        bending_deg = math.degrees(self.bending_rad)
        shaft_deg = math.degrees(self.shaft_rad)
        return (
            f"{bending_deg:.1f} deg between first and last link, with the shaft at "
            f"{shaft_deg:.0f} deg"
        )


def predict_bending(rig: RigModel, height_m: float, speed_rad_s: float) -> Bending:
    """Bending over one turn on the ground, which bends the leg backwards; swinging in the air is
    not counted.
    """
    turn = _turn(rig, height_m, speed_rad_s)
    # Positive where the tip lags behind the first link, which is how the ground bends the leg.
    back_rad = turn.q_rad[:, 0] - turn.q_rad[:, -1]
    most = int(np.argmax(back_rad))
    return Bending(float(back_rad[most]), float(turn.q_rad[most, 0]))


def turn_loads(plan: Plan, rig: RigModel) -> dict[Stage, Load]:
    """Load of each stage of cycles, and of moves forwards directly after the rack, which may
    begin anywhere in a turn.
    """
    loads: dict[tuple[float, float], Load] = {}
    conditions = dict(_turns(plan))
    for condition in set(conditions.values()):
        turn = _turn(rig, *condition)
        loads[condition] = Load(
            float(np.hypot(turn.fy_N, turn.fz_N).max()), float(np.abs(turn.tx_Nm).max())
        )
    return {stage: loads[condition] for stage, condition in conditions.items()}


def _turns(plan: Plan) -> Iterator[tuple[Stage, tuple[float, float]]]:
    """Each stage with its height and speed."""
    before: Stage | None = None
    for stage in plan.stages:
        if isinstance(stage, Cycles):
            yield stage, (stage.height_m, stage.speed_rad_s)
        # Only a resumed plan has such a move: the shaft may stand anywhere, even on the ground, so
        # a whole turn is assumed.
        elif isinstance(stage, MoveShaft) and stage.forwards and isinstance(before, SetHeight):
            yield stage, (before.height_m, stage.speed_rad_s)
        before = stage


def _turn(rig: RigModel, height_m: float, speed_rad_s: float) -> SimulatedStroke:
    return simulate_stroke_at_speed(
        rig, height_m, speed_rad_s, np.arange(0.0, TURN_RAD / speed_rad_s, SAMPLE_S)
    )


def predict_loads(plan: Plan, rig: RigModel) -> dict[Stage, Load]:
    """The predicted load of each stroke, of each hold of a static sequence, and of its other moves.

    A static sequence is simulated height by height, as the plan moves the shaft, so that a leg
    which wedges when it is pushed back is found beforehand. Which link ends touch is part of the
    model's solution. A hold's load is the largest on the way to it and at it.
    """
    return {**_flaps(plan, rig), **turn_loads(plan, rig), **_holds(plan, rig)}


def _flaps(plan: Plan, rig: RigModel) -> dict[Stage, Load]:
    # Repeats have the same load: each condition is simulated once.
    by_condition: dict[tuple[float, float], Load] = {}
    strokes = [stage for stage in plan.stages if isinstance(stage, Approach | Flap)]
    for flap in strokes:
        condition = (flap.height_m, flap.speed_rad_s)
        if condition not in by_condition:
            t_s = np.arange(0.0, flap.stroke_s, SAMPLE_S)
            stroke = simulate_stroke_at_speed(rig, flap.height_m, flap.speed_rad_s, t_s)
            by_condition[condition] = _load(stroke, slice(None))
    return {flap: by_condition[flap.height_m, flap.speed_rad_s] for flap in strokes}


def _holds(plan: Plan, rig: RigModel) -> dict[Stage, Load]:
    expected: dict[Stage, Load] = {}
    # Equal sequences, for example the checks of a fatigue run, are simulated once.
    known: dict[Motion, Loads] = {}
    for height_m, stages in _sequences(plan):
        motion = (
            height_m,
            tuple(stage if isinstance(stage, MoveShaft) else None for stage in stages),
        )
        if motion not in known:
            known[motion] = _along(height_m, stages, rig)
        for index, load in known[motion]:
            expected[stages[index]] = load.max_with(expected.get(stages[index], load))
    return expected


def _sequences(plan: Plan) -> list[tuple[float, list[MoveShaft | Hold]]]:
    """Moves and holds between two settings of the rack. Strokes and cycles divide them, because
    each ends at the start angle.
    """
    sequences: list[tuple[float, list[MoveShaft | Hold]]] = []
    for stage in plan.stages:
        if isinstance(stage, SetHeight | Approach | Flap | Cycles):
            sequences.append((stage.height_m, []))
        elif sequences and isinstance(stage, MoveShaft | Hold):
            sequences[-1][1].append(stage)
    with_holds = []
    for height_m, stages in sequences:
        if any(isinstance(stage, Hold) for stage in stages):
            with_holds.append((height_m, stages))
    return with_holds


def _along(height_m: float, stages: list[MoveShaft | Hold], rig: RigModel) -> Loads:
    """Simulates moves at their speeds and short holds; returns the load of each hold, its way
    included, and of other moves.
    """
    angles = [rig.leg.start_angle_rad]
    times = [0.0]
    for stage in stages:
        if isinstance(stage, MoveShaft):
            way_rad = turn_to(stage.angle_rad, angles[-1], stage.forwards)
            # A move of no length still takes one sample: a piece of zero duration has no speed.
            duration_s = max(abs(way_rad) / stage.speed_rad_s, SLOW_SAMPLE_S)
        else:
            way_rad = 0.0
            duration_s = HOLD_S
        times.append(times[-1] + duration_s)
        angles.append(angles[-1] + way_rad)
    t_s = np.arange(0.0, times[-1], SLOW_SAMPLE_S)
    times_s = np.array(times)
    angles_rad = np.array(angles)
    speeds = np.diff(angles_rad) / np.diff(times_s)
    # Cubic pieces of a motion with constant speed: angle, speed, and two coefficients of zero.
    pieces = np.column_stack(
        [angles_rad[:-1], speeds, np.zeros_like(speeds), np.zeros_like(speeds)]
    )
    simulated = simulate_stroke(rig, height_m, ShaftMotion(times_s, pieces, times_s[:-1]), t_s)
    parts = enumerate(pairwise(times))
    return [
        (_stage_that_counts(index, stages), _load(simulated, (t_s >= begin_s) & (t_s <= end_s)))
        for index, (begin_s, end_s) in parts
    ]


def _stage_that_counts(index: int, stages: list[MoveShaft | Hold]) -> int:
    """Index of the hold that this move leads to directly, else of the stage itself."""
    if (
        index + 1 < len(stages)
        and isinstance(stages[index + 1], Hold)
        and isinstance(stages[index], MoveShaft)
    ):
        return index + 1
    return index


def _load(stroke: SimulatedStroke, part: slice | NDArray[np.bool_]) -> Load:
    force_N = np.hypot(stroke.fy_N[part], stroke.fz_N[part])
    return Load(float(force_N.max(initial=0.0)), float(np.abs(stroke.tx_Nm[part]).max(initial=0.0)))
