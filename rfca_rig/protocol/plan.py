"""A plan is data: a list of frozen stages that check, printout, progress bar and run all go
through.

A fatigue run has turns by the thousand, and checks of the leg's stiffness between them.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, Protocol

import numpy as np

Direction = Literal["loading", "unloading"]
Experiment = Literal["static", "dynamic", "fatigue"]

# Counts, sequence, status, host and device time.
FORCE_RECORD_BYTES = 6 * 4 + 4 + 4 + 8 + 8
SHAFT_RECORD_BYTES = 4 * 8

# Number, four values, host and device time.
CYCLE_RECORD_BYTES = 4 + 4 * 4 + 8 + 8


@dataclass(frozen=True)
class Rates:
    """Records per second of each device, for estimates of size."""

    force_Hz: float
    shaft_Hz: float

    def bytes_in(self, duration_s: float) -> int:
        """Uncompressed size of a recording of that length."""
        return int(
            duration_s * (self.force_Hz * FORCE_RECORD_BYTES + self.shaft_Hz * SHAFT_RECORD_BYTES)
        )


class Stage(Protocol):
    """One step of a plan. `duration_s` is an upper bound, time limits included."""

    @property
    def label(self) -> str: ...

    @property
    def duration_s(self) -> float: ...

    @property
    def recorded_s(self) -> float: ...


@dataclass(frozen=True)
class SetHeight:
    """Sets the rack to a height of the shaft above the ground; on a real rig a person turns the
    lead screws.
    """

    height_m: float
    recorded_s: float = 0.0
    duration_s: float = 0.0

    @property
    def label(self) -> str:
        return f"rack to {1e3 * self.height_m:.1f} mm"


@dataclass(frozen=True)
class MoveShaft:
    """The shaft turns to an angle at a bounded speed: the nearest way, or forwards, over the top.

    `longest_turn_rad` bounds the way for the plan's duration, because the plan does not know where
    the shaft will stand.
    """

    angle_rad: float
    speed_rad_s: float
    forwards: bool = False
    longest_turn_rad: float = 2.0 * np.pi
    recorded_s: float = 0.0

    @property
    def label(self) -> str:
        return f"shaft to {np.degrees(self.angle_rad):.1f} deg"

    @property
    def duration_s(self) -> float:
        return self.longest_turn_rad / self.speed_rad_s + MOVE_RAMP_S


# Seconds of acceleration, and of deceleration, of a move and of a stage of cycles.
MOVE_RAMP_S = 0.2
TURN_RAD = 2.0 * math.pi


def turn_to(angle_rad: float, from_rad: float, forwards: bool) -> float:
    """Signed angle in rad to turn to `angle_rad`, whole turns aside: the nearest way, or in the
    positive direction.
    """
    # IEEE remainder: within half a turn either way, hence the nearest.
    way_rad = math.remainder(angle_rad - from_rad, TURN_RAD)
    if forwards and way_rad < 0.0:
        return way_rad + TURN_RAD
    return way_rad


@dataclass(frozen=True)
class SettleCriterion:
    """Settled when force and angle stay inside their bands (peak to peak, of 50 ms means) for
    `for_s`; given up after `limit_s`.
    """

    force_band_N: float
    angle_band_rad: float
    for_s: float
    limit_s: float


@dataclass(frozen=True)
class Rest:
    """Holds the shaft until leg and sensor have come to rest."""

    settle: SettleCriterion
    recorded_s: float = 0.0
    label: str = "come to rest"

    @property
    def duration_s(self) -> float:
        return self.settle.limit_s


def flap_label(height_m: float, speed_rad_s: float, repeat: int) -> str:
    """Name of a stroke in messages and files."""
    return f"flap {1e3 * height_m:.0f} mm, {speed_rad_s:g} rad/s, repeat {repeat}"


@dataclass(frozen=True)
class Flap:
    """One recorded stroke: at rest for `before_s`, then linearly to speed within `ramp_s`, on
    for `sweep_rad`, then to a stop.
    """

    height_m: float
    speed_rad_s: float
    repeat: int
    ramp_s: float
    sweep_rad: float
    before_s: float = 0.2

    @property
    def label(self) -> str:
        return flap_label(self.height_m, self.speed_rad_s, self.repeat)

    @property
    def stroke_s(self) -> float:
        """From the commanded start to the end of the sweep."""
        # A linear ramp covers half the way of the same time at full speed.
        return self.sweep_rad / self.speed_rad_s + 0.5 * self.ramp_s

    @property
    def recorded_s(self) -> float:
        return self.before_s + self.stroke_s

    @property
    def duration_s(self) -> float:
        return self.recorded_s + STOPPING_S


# Seconds in which a stroke decelerates to rest in the air, after its sweep.
STOPPING_S = 0.2


@dataclass(frozen=True)
class Approach:
    """A stroke at a share of the full speed: its force predicts that of the full speed. Not
    recorded as a stroke.
    """

    height_m: float
    speed_rad_s: float
    full_speed_rad_s: float
    ramp_s: float
    sweep_rad: float
    recorded_s: float = 0.0

    @property
    def label(self) -> str:
        return (
            f"first strokes at {1e3 * self.height_m:.0f} mm: {self.speed_rad_s:g} of "
            f"{self.full_speed_rad_s:g} rad/s"
        )

    @property
    def stroke_s(self) -> float:
        """From the commanded start to the end of the sweep."""
        return self.sweep_rad / self.speed_rad_s + 0.5 * self.ramp_s

    @property
    def duration_s(self) -> float:
        return self.stroke_s + STOPPING_S


@dataclass(frozen=True)
class HoldTiming:
    """Times of a hold once the leg has settled: waits `dwell_s` more, averages for `average_s`,
    meanwhile a photo is taken.

    A photo that has not come `photo_limit_s` after its request is omitted; 0 requests none.
    """

    dwell_s: float
    average_s: float
    photo_limit_s: float = 0.0

    @property
    def duration_s(self) -> float:
        return self.dwell_s + max(self.average_s, self.photo_limit_s)


@dataclass(frozen=True)
class Hold:
    """One recorded stage of the static experiment: the shaft stands until settled, then means
    are taken, and a photo.
    """

    height_m: float
    number: int
    direction: Direction
    angle_rad: float
    settle: SettleCriterion
    timing: HoldTiming

    @property
    def label(self) -> str:
        return (
            f"hold {self.number} at {np.degrees(self.angle_rad):.1f} deg, "
            f"{1e3 * self.height_m:.0f} mm, {self.direction}"
        )

    @property
    def recorded_s(self) -> float:
        return self.timing.average_s

    @property
    def duration_s(self) -> float:
        return self.settle.limit_s + self.timing.duration_s


@dataclass(frozen=True)
class Limits:
    """Limits that stop the motion at once. All must be set; there is no 'unlimited'.

    `above_expected` times the predicted load of a stage may be passed for `above_expected_s`, as
    impacts do, and no longer. `late_s` is how late the control loop may be, which must be less than
    the drive's watchdog. `reading_age_s` is how old the drive's angle and torque may be.
    """

    force_N: float
    torque_Nm: float
    speed_rad_s: float
    following_error_rad: float
    following_error_s: float
    sensor_silent_s: float
    drive_silent_s: float
    sensor_frozen_s: float
    above_expected: float
    above_expected_s: float
    temperature_C: float
    late_s: float
    reading_age_s: float


@dataclass(frozen=True)
class Plan:
    """The stages of a run in order, with limits and rates."""

    title: str
    experiment: Experiment
    stages: Sequence[Stage]
    limits: Limits
    rates: Rates

    @property
    def duration_s(self) -> float:
        """Upper bound of the run's time, without trips and the operator's time at the lead
        screws.
        """
        return sum(stage.duration_s for stage in self.stages)

    @property
    def recorded_bytes(self) -> int:
        """Size of the recording before compression."""
        return sum(self.rates.bytes_in(stage.recorded_s) for stage in self.stages)

    @property
    def flaps(self) -> list[Flap]:
        return [stage for stage in self.stages if isinstance(stage, Flap)]

    @property
    def holds(self) -> list[Hold]:
        return [stage for stage in self.stages if isinstance(stage, Hold)]

    @property
    def photos(self) -> int:
        """Number of photos to be taken."""
        return sum(hold.timing.photo_limit_s > 0 for hold in self.holds)


@dataclass(frozen=True)
class Cycles:
    """The shaft turns forwards without pause; each turn bends the leg once at the ground. Of each
    only a row of numbers is recorded.

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
        return (
            f"cycles {self.first} to {self.last}, {1e3 * self.height_m:.1f} mm, "
            f"{self.speed_rad_s:g} rad/s"
        )

    @property
    def duration_s(self) -> float:
        # Each of the two ramps takes longer than the same way at full speed; MOVE_RAMP_S each is an
        # upper bound.
        return self.count * TURN_RAD / self.speed_rad_s + 2 * MOVE_RAMP_S


@dataclass(frozen=True)
class StiffnessCheck:
    """Compares the last `holds` static stages with the first ones; the run ends where the leg's
    stiffness has drifted too far.

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


def whole_turns(stage: Stage, from_rad: float) -> float | None:
    """Whole turns in rad to subtract from the shaft's continuous angle in a stage.

    The continuous angle grows by a turn with every stroke. Without these turns, a move ends at the
    angle that it states, a hold stands at its own, and strokes begin in their first turn.

    Parameters
    ----------
    stage
        The stage that begins.
    from_rad
        Continuous commanded angle at which it begins.

    Returns
    -------
    float or None
        None for a stage that has no angle of its own: the turns of the stage before hold.
    """
    match stage:
        case MoveShaft():
            goal_rad = from_rad + turn_to(stage.angle_rad, from_rad, stage.forwards)
            return turns_between(stage.angle_rad, goal_rad)
        case Hold():
            return turns_between(stage.angle_rad, from_rad)
        case Approach() | Cycles() | Flap():
            return turns_between(0.0, from_rad)
    return None


def turns_between(angle_rad: float, continuous_rad: float) -> float:
    """Whole turns in rad, to the nearest, by which a continuous angle is ahead of an angle."""
    return TURN_RAD * round((continuous_rad - angle_rad) / TURN_RAD)


def cycles_in(plan: Plan) -> list[Cycles]:
    return [stage for stage in plan.stages if isinstance(stage, Cycles)]


def cycle_bytes(plan: Plan) -> int:
    """Size of the table of cycles in bytes before compression; strokes and static stages are not
    in it.
    """
    return CYCLE_RECORD_BYTES * sum(stage.count for stage in cycles_in(plan))
