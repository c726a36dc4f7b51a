"""The two experiments of the paper as plans: flapping at heights and speeds, and static stages of the shaft angle."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import groupby

from rfca_rig.protocol.plan import (
    Approach,
    Direction,
    Flap,
    Hold,
    HoldTiming,
    Limits,
    MoveShaft,
    Plan,
    Rates,
    Rest,
    SetHeight,
    SettleCriterion,
    Stage,
)


@dataclass(frozen=True)
class PlannedCondition:
    """One height of the rack and one speed of the shaft."""

    height_m: float
    speed_rad_s: float


@dataclass(frozen=True)
class Flapping:
    """Strokes at each condition, `repeats` times. After a stroke the shaft goes on over the top to the start angle."""

    title: str
    conditions: Sequence[PlannedCondition]
    repeats: int
    sweep_rad: float
    return_speed_rad_s: float
    settle: SettleCriterion


@dataclass(frozen=True)
class StaticStages:
    """Shaft angles at each height, each with its direction of loading.

    After the leg has settled, `dwell_s` is waited and `average_s` measured. `photo` requests a photo at every stage of a rig with a camera.
    """

    title: str
    heights_m: Sequence[float]
    angles_rad: Sequence[tuple[float, Direction]]
    move_speed_rad_s: float
    settle: SettleCriterion
    average_s: float
    dwell_s: float = 0.0
    photo: bool = True


@dataclass(frozen=True)
class RigFacts:
    """The rig's properties that a plan needs: start angle, parking angle, ramp, limits, rates.

    `photo_limit_s` is how long a photo may take; 0 without a camera. `first_strokes` are shares of a condition's speed, for first strokes
    that predict the force at full speed; empty where nothing can be damaged.
    """

    start_angle_rad: float
    parked_angle_rad: float
    ramp_s: float
    limits: Limits
    rates: Rates
    photo_limit_s: float = 0.0
    first_strokes: Sequence[float] = ()


def flapping_plan(experiment: Flapping, rig: RigFacts) -> Plan:
    """Plan of strokes: rack, start angle, then rest and stroke again and again; the shaft is parked before the rack moves."""
    return Plan(experiment.title, "dynamic", tuple(_flapping_stages(experiment, rig)), rig.limits, rig.rates)


def _flapping_stages(experiment: Flapping, rig: RigFacts) -> Iterator[Stage]:
    speed = experiment.return_speed_rad_s
    # Consecutive conditions of one height share one setting of the rack, which takes a person.
    for height_m, conditions in groupby(experiment.conditions, key=lambda condition: condition.height_m):
        yield SetHeight(height_m)
        yield MoveShaft(rig.start_angle_rad, speed)
        for condition in conditions:
            for share in rig.first_strokes:
                yield Rest(experiment.settle)
                yield Approach(height_m, share * condition.speed_rad_s, condition.speed_rad_s, rig.ramp_s, experiment.sweep_rad)
                yield MoveShaft(rig.start_angle_rad, speed, forwards=True)
            for repeat in range(1, experiment.repeats + 1):
                yield Rest(experiment.settle)
                yield Flap(height_m, condition.speed_rad_s, repeat, rig.ramp_s, experiment.sweep_rad)
                yield MoveShaft(rig.start_angle_rad, speed, forwards=True)
        yield MoveShaft(rig.parked_angle_rad, speed)


def static_plan(experiment: StaticStages, rig: RigFacts) -> Plan:
    """Plan of static stages: at each height from the start angle through the stages, and to the parking angle before the rack moves."""
    return Plan(experiment.title, "static", tuple(_static_stages(experiment, rig)), rig.limits, rig.rates)


def _static_stages(experiment: StaticStages, rig: RigFacts) -> Iterator[Stage]:
    speed = experiment.move_speed_rad_s
    timing = HoldTiming(experiment.dwell_s, experiment.average_s, rig.photo_limit_s if experiment.photo else 0.0)
    for height_m in experiment.heights_m:
        yield SetHeight(height_m)
        yield MoveShaft(rig.start_angle_rad, speed)
        yield Rest(experiment.settle)
        for number, (angle_rad, direction) in enumerate(experiment.angles_rad, start=1):
            yield MoveShaft(angle_rad, speed)
            yield Hold(height_m, number, direction, angle_rad, experiment.settle, timing)
        # on, never back: a bent leg that is pushed backwards wedges between shaft and floor, and the force passes every limit
        yield MoveShaft(rig.start_angle_rad, speed, forwards=True)
        yield Rest(experiment.settle)
        yield MoveShaft(rig.parked_angle_rad, speed)
