"""Stages of a fatigue run: turns by the thousand, and checks of the leg's stiffness between them."""

from dataclasses import dataclass

from rfca_rig.protocol.plan import MOVE_RAMP_S, TURN_RAD, Plan

# Number, four values, host and device time.
CYCLE_RECORD_BYTES = 4 + 4 * 4 + 8 + 8


@dataclass(frozen=True)
class Cycles:
    """The shaft turns forwards without pause; each turn bends the leg once at the ground. Of each only a row of numbers is recorded.

    `first` is the number of the first of them, counted from 1 over the whole run.
    """

    height_m: float
    speed_rad_s: float
    first: int
    count: int
    recorded_s: float = 0.0

    @property
    def last(self) -> int:
        return self.first + self.count - 1

    @property
    def label(self) -> str:
        return f"cycles {self.first} to {self.last}, {1e3 * self.height_m:.1f} mm, {self.speed_rad_s:g} rad/s"

    @property
    def duration_s(self) -> float:
        # Each of the two ramps takes longer than the same way at full speed; MOVE_RAMP_S each is an upper bound.
        return self.count * TURN_RAD / self.speed_rad_s + 2 * MOVE_RAMP_S


@dataclass(frozen=True)
class StiffnessCheck:
    """Compares the last `holds` static stages with the first ones; the run ends where the leg's stiffness has drifted too far.

    `number` counts from 1; the first check is what the others are compared with.
    """

    number: int
    holds: int
    drift_limit: float
    recorded_s: float = 0.0
    duration_s: float = 0.0

    @property
    def label(self) -> str:
        return f"stiffness check {self.number}"


def cycles_in(plan: Plan) -> list[Cycles]:
    return [stage for stage in plan.stages if isinstance(stage, Cycles)]


def cycle_bytes(plan: Plan) -> int:
    """Size of the table of cycles in bytes before compression; strokes and static stages are not in it."""
    return CYCLE_RECORD_BYTES * sum(stage.count for stage in cycles_in(plan))
