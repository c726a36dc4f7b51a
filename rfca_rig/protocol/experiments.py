"""Experiments as plans: flapping at heights and speeds, static stages, and fatigue.

Fatigue: turns of the shaft, now and then one recorded in full, and checks of the stiffness in
between.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import groupby

from rfca_rig.protocol.plan import (
    Approach,
    Cycles,
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
    StiffnessCheck,
)


@dataclass(frozen=True)
class PlannedCondition:
    """One height of the rack and one speed of the shaft."""

    height_m: float
    speed_rad_s: float


@dataclass(frozen=True)
class Flapping:
    """Strokes at each condition, `repeats` times. After a stroke the shaft goes on over the top
    to the start angle.
    """

    title: str
    conditions: Sequence[PlannedCondition]
    repeats: int
    sweep_rad: float
    return_speed_rad_s: float
    settle: SettleCriterion


@dataclass(frozen=True)
class StaticStages:
    """Shaft angles at each height, each with its direction of loading.

    After the leg has settled, `dwell_s` is waited and `average_s` measured. `photo` requests a
    photo at every stage of a rig with a camera.
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

    `photo_limit_s` is how long a photo may take; 0 without a camera. `first_strokes` are shares of
    a condition's speed, for first strokes that predict the force at full speed; empty where nothing
    can be damaged.
    """

    start_angle_rad: float
    parked_angle_rad: float
    ramp_s: float
    limits: Limits
    rates: Rates
    photo_limit_s: float = 0.0
    first_strokes: Sequence[float] = ()


def flapping_plan(experiment: Flapping, rig: RigFacts) -> Plan:
    """Plan of strokes: rack, start angle, then rest and stroke again and again; the shaft is
    parked before the rack moves.
    """
    return Plan(
        experiment.title, "dynamic", tuple(_flapping_stages(experiment, rig)), rig.limits, rig.rates
    )


def _flapping_stages(experiment: Flapping, rig: RigFacts) -> Iterator[Stage]:
    speed = experiment.return_speed_rad_s
    # Consecutive conditions of one height share one setting of the rack, which takes a person.
    for height_m, conditions in groupby(
        experiment.conditions, key=lambda condition: condition.height_m
    ):
        yield SetHeight(height_m)
        yield MoveShaft(rig.start_angle_rad, speed)
        for condition in conditions:
            for share in rig.first_strokes:
                yield Rest(experiment.settle)
                yield Approach(
                    height_m,
                    share * condition.speed_rad_s,
                    condition.speed_rad_s,
                    rig.ramp_s,
                    experiment.sweep_rad,
                )
                yield MoveShaft(rig.start_angle_rad, speed, forwards=True)
            for repeat in range(1, experiment.repeats + 1):
                yield Rest(experiment.settle)
                yield Flap(
                    height_m, condition.speed_rad_s, repeat, rig.ramp_s, experiment.sweep_rad
                )
                yield MoveShaft(rig.start_angle_rad, speed, forwards=True)
        yield MoveShaft(rig.parked_angle_rad, speed)


def static_plan(experiment: StaticStages, rig: RigFacts) -> Plan:
    """Plan of static stages: at each height from the start angle through the stages, and to the
    parking angle before the rack moves.
    """
    return Plan(
        experiment.title, "static", tuple(_static_stages(experiment, rig)), rig.limits, rig.rates
    )


def _static_stages(experiment: StaticStages, rig: RigFacts) -> Iterator[Stage]:
    speed = experiment.move_speed_rad_s
    timing = HoldTiming(
        experiment.dwell_s, experiment.average_s, rig.photo_limit_s if experiment.photo else 0.0
    )
    for height_m in experiment.heights_m:
        yield SetHeight(height_m)
        yield MoveShaft(rig.start_angle_rad, speed)
        yield Rest(experiment.settle)
        for number, (angle_rad, direction) in enumerate(experiment.angles_rad, start=1):
            yield MoveShaft(angle_rad, speed)
            yield Hold(height_m, number, direction, angle_rad, experiment.settle, timing)
        # on, never back: a bent leg that is pushed backwards wedges between shaft and floor, and
        # the force passes every limit
        yield MoveShaft(rig.start_angle_rad, speed, forwards=True)
        yield Rest(experiment.settle)
        yield MoveShaft(rig.parked_angle_rad, speed)


@dataclass(frozen=True)
class CheckSettings:
    """Static stages at the same few angles, after every `every` cycles; the run ends where they
    drift by more than `drift_limit`.
    """

    every: int
    angles_rad: Sequence[float]
    move_speed_rad_s: float
    dwell_s: float
    average_s: float
    drift_limit: float


@dataclass(frozen=True)
class Fatigue:
    """`cycles` turns at one height. The first, and every `full_every`-th after it, is a stroke
    from rest that is recorded in full.
    """

    title: str
    height_m: float
    speed_rad_s: float
    cycles: int
    full_every: int
    sweep_rad: float
    return_speed_rad_s: float
    settle: SettleCriterion
    check: CheckSettings


def fatigue_plan(experiment: Fatigue, rig: RigFacts) -> Plan:
    """Plan of checks and cycles in turn, a check at both ends; between any two the shaft comes
    forwards to the start angle.
    """
    return Plan(experiment.title, "fatigue", tuple(_stages(experiment, rig)), rig.limits, rig.rates)


def _stages(experiment: Fatigue, rig: RigFacts) -> Iterator[Stage]:
    # Forwards, never back: a bent leg that is pushed backwards wedges.
    back = MoveShaft(rig.start_angle_rad, experiment.return_speed_rad_s, forwards=True)
    yield SetHeight(experiment.height_m)
    yield MoveShaft(rig.start_angle_rad, experiment.return_speed_rad_s)
    checks = 0
    number = 1
    while number <= experiment.cycles:
        # Before the cycle of that number, so that the first check sees a leg that has not been
        # bent.
        if _is_due(number, experiment.check.every):
            checks += 1
            yield from _check(experiment, checks, back)
        if number == 1:
            yield from _first_strokes(experiment, rig, back)
        if _is_due(number, experiment.full_every):
            yield Rest(experiment.settle)
            yield Flap(
                experiment.height_m,
                experiment.speed_rad_s,
                number,
                rig.ramp_s,
                experiment.sweep_rad,
            )
            yield back
            number += 1
        else:
            # Number of cycles, from that one on, before a check or a full stroke is due.
            until = (
                interval - (number - 1) % interval
                for interval in (experiment.check.every, experiment.full_every)
            )
            count = min(*until, experiment.cycles - number + 1)
            yield Cycles(experiment.height_m, experiment.speed_rad_s, number, count)
            yield back
            number += count
    # One more at the end: without it the last block of cycles would have no result.
    yield from _check(experiment, checks + 1, back)
    yield MoveShaft(rig.parked_angle_rad, experiment.return_speed_rad_s)


def _is_due(number: int, interval: int) -> bool:
    return (number - 1) % interval == 0


def _first_strokes(experiment: Fatigue, rig: RigFacts, back: MoveShaft) -> Iterator[Stage]:
    speed = experiment.speed_rad_s
    for share in rig.first_strokes:
        yield Rest(experiment.settle)
        yield Approach(experiment.height_m, share * speed, speed, rig.ramp_s, experiment.sweep_rad)
        yield back


def _check(experiment: Fatigue, number: int, back: MoveShaft) -> Iterator[Stage]:
    check = experiment.check
    angles = check.angles_rad
    timing = HoldTiming(check.dwell_s, check.average_s)
    # Holds are numbered over the whole run: resuming identifies static stages by height and number.
    for hold_number, angle_rad in enumerate(angles, start=(number - 1) * len(angles) + 1):
        yield MoveShaft(angle_rad, check.move_speed_rad_s)
        yield Hold(
            experiment.height_m, hold_number, "loading", angle_rad, experiment.settle, timing
        )
    yield back
    yield StiffnessCheck(number, len(angles), check.drift_limit)
