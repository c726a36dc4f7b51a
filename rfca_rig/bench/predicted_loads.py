"""Loads of whole turns that the nominal model predicts: cycles, and the way home after a stop; and how far the leg bends."""

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from rfca_rig.model.parameters import RigModel
from rfca_rig.model.stroke import SimulatedStroke, simulate_stroke_at_speed
from rfca_rig.protocol.check import Load
from rfca_rig.protocol.cycles import Cycles
from rfca_rig.protocol.plan import TURN_RAD, MoveShaft, Plan, SetHeight, Stage

SAMPLE_S = 1e-3


@dataclass(frozen=True)
class Bending:
    """The largest angle between the last link and the first in one turn, and the shaft angle there; in rad."""

    bending_rad: float
    shaft_rad: float

    def text(self) -> str:
        bending_deg, shaft_deg = math.degrees(self.bending_rad), math.degrees(self.shaft_rad)
        return f"{bending_deg:.1f} deg between first and last link, with the shaft at {shaft_deg:.0f} deg"


def predict_bending(rig: RigModel, height_m: float, speed_rad_s: float) -> Bending:
    """Bending over one turn on the ground, which bends the leg backwards; swinging in the air is not counted."""
    turn = _turn(rig, height_m, speed_rad_s)
    # Positive where the tip lags behind the first link, which is how the ground bends the leg.
    back_rad = turn.q_rad[:, 0] - turn.q_rad[:, -1]
    most = int(np.argmax(back_rad))
    return Bending(float(back_rad[most]), float(turn.q_rad[most, 0]))


def turn_loads(plan: Plan, rig: RigModel) -> dict[Stage, Load]:
    """Load of each stage of cycles, and of moves forwards directly after the rack, which may begin anywhere in a turn."""
    found: dict[tuple[float, float], Load] = {}
    conditions = dict(_turns(plan))
    for condition in set(conditions.values()):
        found[condition] = _load(_turn(rig, *condition))
    return {stage: found[condition] for stage, condition in conditions.items()}


def _turns(plan: Plan) -> Iterator[tuple[Stage, tuple[float, float]]]:
    """Each stage with its height and speed."""
    before: Stage | None = None
    for stage in plan.stages:
        if isinstance(stage, Cycles):
            yield stage, (stage.height_m, stage.speed_rad_s)
        # Only a resumed plan has such a move: the shaft may stand anywhere, even on the ground, so a whole turn is
        # assumed.
        elif isinstance(stage, MoveShaft) and stage.forwards and isinstance(before, SetHeight):
            yield stage, (before.height_m, stage.speed_rad_s)
        before = stage


def _turn(rig: RigModel, height_m: float, speed_rad_s: float) -> SimulatedStroke:
    return simulate_stroke_at_speed(rig, height_m, speed_rad_s, np.arange(0.0, TURN_RAD / speed_rad_s, SAMPLE_S))


def _load(turn: SimulatedStroke) -> Load:
    return Load(float(np.hypot(turn.fy_N, turn.fz_N).max()), float(np.abs(turn.tx_Nm).max()))
