"""Experiments that the rig can do: each as if recorded already under one hypothesis, so that all of them can be held against it."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Literal, Protocol

import numpy as np
from numpy.typing import NDArray

from rfca_rig.analysis.fitting.parameters import Supposed
from rfca_rig.analysis.phases import Refused
from rfca_rig.analysis.repeats import Condition
from rfca_rig.bench.expectation import expected_loads
from rfca_rig.diagnosis.experiment_design.feasible_region import FeasibleRegion, load_of
from rfca_rig.diagnosis.experiment_design.next_protocol import RETURN_RAD_S, SWEEP_RAD, protocol_of
from rfca_rig.diagnosis.leg.shaft_observations import SIGNAL, ShaftCondition, shaft_condition
from rfca_rig.diagnosis.leg.stages import stage_tables
from rfca_rig.diagnosis.leg.strokes import BOUNDED, FORCES, FlapCondition, Turn, flap_condition
from rfca_rig.diagnosis.simulator import ConditionData
from rfca_rig.model.static_stages import StageMoves
from rfca_rig.model.stroke import stroke_following
from rfca_rig.protocol.check import Load
from rfca_rig.protocol.experiments import RigFacts, static_plan
from rfca_rig.protocol.plan import Direction, Limits, Rates
from rfca_rig.recording.form import Column, StaticStage, Stream, Stroke

Floats = NDArray[np.float64]
Kind = Literal["dynamic", "static", "slow reversal", "hold", "release", "sine torque"]  # the last two of pendulums
Stages = tuple[tuple[float, Direction], ...]

SET_UP_MIN = 2.0  # rack, start angle, arming, a look at the leg
REST_S = 1.5  # before a stroke the leg comes to rest
SETTLE_S = 1.5
AVERAGE_S = 0.5
TURN_RAD = 2.0 * np.pi
REPEATS = (3, 5, 10)
HEIGHTS, SPEEDS = 4, 4
SLOWEST_RAD_S = 1.0
SAME_HEIGHT_M, SAME_SPEED = 0.004, 0.15  # nearer conditions than these show the same
SAMPLE_S = 1e-3
BEFORE_S = 0.2  # a recording begins that long before the motion
STAGE_MOVES = StageMoves(0.4, 0.2, 1.0)

LOADING: Stages = tuple((deg, "loading") for deg in (60.0, 75.0, 90.0, 105.0, 120.0, 135.0))
BACK: Stages = tuple((deg, "unloading") for deg in (133.0, 131.0, 129.0))
FORTH: Stages = tuple((deg, "loading") for deg in (131.0, 133.0, 135.0))
SEQUENCES: Mapping[Kind, Stages] = {
    "static": LOADING,
    "slow reversal": (*LOADING[2:], *BACK, *FORTH),
    "hold": tuple((deg, "loading") for deg in (60.0, *[120.0] * 6)),
}


class Candidate(Protocol):
    """One experiment on the rig. `repeats` are the numbers that come into question."""

    @property
    def kind(self) -> Kind: ...

    @property
    def repeats(self) -> tuple[int, ...]: ...

    def minutes(self, repeats: int) -> float:
        """What it usually takes, hands on the rack included."""
        ...

    def part(self, supposed: Supposed) -> ConditionData | None:
        """As if recorded once; None where the rig may not do it or it would show nothing. Raises SimulationFailed."""
        ...

    def described(self) -> dict[str, object]:
        """Kind and settings, as the diagnosis states them."""
        ...


@dataclass(frozen=True)
class FlapCandidate:
    """Strokes at a height and speed that were not recorded; `like` says how they were recorded elsewhere, `shaft` the same of its angle."""

    height_m: float
    speed_rad_s: float
    room: FeasibleRegion
    noise: Mapping[str, float]
    start_rad: float | None
    shaft: ShaftCondition | None = None
    kind: Kind = "dynamic"
    repeats: tuple[int, ...] = REPEATS

    def minutes(self, repeats: int) -> float:
        """Rest, stroke and the way back over the top, again and again."""
        one_s = REST_S + SWEEP_RAD / self.speed_rad_s + (TURN_RAD - SWEEP_RAD) / min(RETURN_RAD_S, self.speed_rad_s) + 0.5
        return SET_UP_MIN + repeats * one_s / 60.0

    def part(self, supposed: Supposed) -> FlapCondition | ShaftCondition | None:
        """The stroke, or the shaft's part of it where that is in question."""
        stroke = self._stroke(supposed)
        if stroke is None:
            return None
        condition = Condition(self.height_m, self.speed_rad_s, (stroke,))
        flap = flap_condition(condition, self.noise, self._turn)
        if isinstance(flap, Refused):
            return None
        if self.shaft is None:
            return flap
        found = shaft_condition(condition, float(flap.t_s[-1]), supposed.rig.drive.ramp_s)
        return None if found is None else replace(found, sample_noise_rad=self.shaft.sample_noise_rad)

    @property
    def _turn(self) -> Turn:
        return Turn(self.speed_rad_s, self.start_rad)

    def _stroke(self, supposed: Supposed) -> Stroke | None:
        """As recorded without noise; None where it would load the rig too much."""
        end_s = SWEEP_RAD / self.speed_rad_s + 0.5 * supposed.rig.drive.ramp_s
        swing = supposed.rig.swing
        begin_s = -BEFORE_S if swing is None else -min(BEFORE_S, swing.before_s)
        t_s = np.arange(begin_s, end_s, SAMPLE_S)
        motion = self._turn.motion(supposed, float(t_s[-1]))
        found = stroke_following(supposed.rig, self.height_m + supposed.height_offset_m, motion, t_s, BOUNDED)
        if not self.room.allows(load_of(found)):
            return None
        columns = {name: Column(getattr(found, name), "") for name in (*FORCES, SIGNAL)}
        return Stroke(self.height_m, self.speed_rad_s, 1, {"table": Stream(t_s, columns)})

    def described(self) -> dict[str, object]:
        return {"kind": self.kind, "height_mm": round(1e3 * self.height_m, 3), "speed_rad_s": self.speed_rad_s}


@dataclass(frozen=True)
class StageCandidate:
    """Shaft angles to go through at one height."""

    kind: Kind
    height_m: float
    room: FeasibleRegion
    noise: Mapping[str, float | None]
    repeats: tuple[int, ...] = (1,)

    @property
    def stages(self) -> Stages:
        return SEQUENCES[self.kind]

    def minutes(self, repeats: int) -> float:
        """Moves, settling and readings; once through, and on to where the shaft waits."""
        way_rad = float(np.radians(sum(abs(b[0] - a[0]) for a, b in pairwise(self.stages))))
        moving_s = (way_rad + TURN_RAD) / STAGE_MOVES.speed_rad_s
        return SET_UP_MIN + repeats * (moving_s + len(self.stages) * (SETTLE_S + AVERAGE_S)) / 60.0

    def part(self, supposed: Supposed) -> ConditionData | None:
        """The table; None where the leg would wedge or press too hard on the way."""
        if not all(self.room.allows(load) for load in self._loads(supposed)):
            return None
        empty = [
            StaticStage(self.height_m, number, direction, float(np.radians(deg)), (), 0.0, 0.0, 0.0)
            for number, (deg, direction) in enumerate(self.stages, start=1)
        ]
        (table,) = stage_tables(empty, self.noise, STAGE_MOVES)
        forces = table.simulated(supposed).reshape(len(FORCES), -1).T
        filled = [replace(s, fy_N=float(fy), fz_N=float(fz), tx_Nm=float(tx)) for s, (fy, fz, tx) in zip(empty, forces, strict=True)]
        return stage_tables(filled, self.noise, STAGE_MOVES)[0]

    def _loads(self, supposed: Supposed) -> list[Load]:
        settled = replace(supposed.rig, swing=None)
        facts = RigFacts(settled.leg.start_angle_rad, settled.leg.start_angle_rad, settled.drive.ramp_s, NO_LIMITS, Rates(1e3, 1e3))
        plan = static_plan(protocol_of(self.described()).static_stages(), facts)  # type: ignore[union-attr]
        return list(expected_loads(plan, settled).values())

    def described(self) -> dict[str, object]:
        stages = [{"angle_deg": deg, "direction": direction} for deg, direction in self.stages]
        return {"kind": self.kind, "height_mm": round(1e3 * self.height_m, 3), "stages": stages}


NO_LIMITS = Limits(*[np.inf] * 12)  # loads are held against the room


def flap_conditions(flaps: Sequence[FlapCondition], heights_m: Sequence[float], room: FeasibleRegion) -> Iterator[tuple[float, float]]:
    """Heights and speeds over the room that are not those of a recorded condition."""
    slowest = min([SLOWEST_RAD_S, room.speed_rad_s, *(0.7 * flap.turn.speed_rad_s for flap in flaps)])
    for height_m in _round_heights(room, heights_m):
        for speed in {round(float(v), 1) for v in np.linspace(slowest, room.speed_rad_s, SPEEDS)}:
            if 0.0 < speed <= room.speed_rad_s and not any(_same(flap, height_m, speed) for flap in flaps):
                yield height_m, speed


def _same(flap: FlapCondition, height_m: float, speed_rad_s: float) -> bool:
    return abs(flap.height_m - height_m) < SAME_HEIGHT_M and abs(flap.turn.speed_rad_s / speed_rad_s - 1.0) < SAME_SPEED


def stage_heights(taken_m: Sequence[float], heights_m: Sequence[float], room: FeasibleRegion) -> list[float]:
    """Heights at which no table was read yet; two of one height would be taken for one sequence."""
    return [h for h in _round_heights(room, heights_m) if all(abs(h - taken) >= SAME_HEIGHT_M for taken in taken_m)]


def _round_heights(room: FeasibleRegion, heights_m: Sequence[float]) -> list[float]:
    """Those recorded, and some between the room's ends on whole 5 mm."""
    spread = np.linspace(np.ceil(room.lowest_m / 5e-3), np.floor(room.highest_m / 5e-3), HEIGHTS)
    heights = {round(5e-3 * round(float(h)), 6) for h in spread} | {round(h, 6) for h in heights_m}
    return sorted(h for h in heights if h > 0.0 and room.lowest_m - 1e-9 <= h <= room.highest_m + 1e-9)
