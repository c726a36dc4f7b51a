"""Fatigue as a plan: turns of the shaft, now and then one recorded in full, and checks of the stiffness in between."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from rfca_rig.protocol.cycles import Cycles, StiffnessCheck
from rfca_rig.protocol.experiments import RigFacts
from rfca_rig.protocol.plan import Approach, Flap, Hold, HoldTiming, MoveShaft, Plan, Rest, SetHeight, SettleCriterion, Stage


@dataclass(frozen=True)
class CheckSettings:
    """Static stages at the same few angles, after every `every` cycles; the run ends where they drift by more than `drift_limit`."""

    every: int
    angles_rad: Sequence[float]
    move_speed_rad_s: float
    dwell_s: float
    average_s: float
    drift_limit: float


@dataclass(frozen=True)
class Fatigue:
    """`cycles` turns at one height. The first, and every `full_every`-th after it, is a stroke from rest that is recorded in full."""

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
    """Plan of checks and cycles in turn, a check at both ends; between any two the shaft comes forwards to the start angle."""
    return Plan(experiment.title, "fatigue", tuple(_stages(experiment, rig)), rig.limits, rig.rates)


def _stages(experiment: Fatigue, rig: RigFacts) -> Iterator[Stage]:
    # Forwards, never back: a bent leg that is pushed backwards wedges.
    back = MoveShaft(rig.start_angle_rad, experiment.return_speed_rad_s, forwards=True)
    yield SetHeight(experiment.height_m)
    yield MoveShaft(rig.start_angle_rad, experiment.return_speed_rad_s)
    checks, number = 0, 1
    while number <= experiment.cycles:
        # Before the cycle of that number, so that the first check sees a leg that has not been bent.
        if _is_due(number, experiment.check.every):
            checks += 1
            yield from _check(experiment, checks, back)
        if number == 1:
            yield from _first_strokes(experiment, rig, back)
        if _is_due(number, experiment.full_every):
            yield from _in_full(experiment, number, rig, back)
            number += 1
        else:
            count = _until_next(number, experiment)
            yield Cycles(experiment.height_m, experiment.speed_rad_s, number, count)
            yield back
            number += count
    # One more at the end: without it the last block of cycles would have no result.
    yield from _check(experiment, checks + 1, back)
    yield MoveShaft(rig.parked_angle_rad, experiment.return_speed_rad_s)


def _is_due(number: int, every: int) -> bool:
    return (number - 1) % every == 0


def _until_next(number: int, experiment: Fatigue) -> int:
    """Number of cycles, from that one on, before a check or a full stroke is due."""
    until = (every - (number - 1) % every for every in (experiment.check.every, experiment.full_every))
    return min(*until, experiment.cycles - number + 1)


def _first_strokes(experiment: Fatigue, rig: RigFacts, back: MoveShaft) -> Iterator[Stage]:
    speed = experiment.speed_rad_s
    for share in rig.first_strokes:
        yield Rest(experiment.settle)
        yield Approach(experiment.height_m, share * speed, speed, rig.ramp_s, experiment.sweep_rad)
        yield back


def _in_full(experiment: Fatigue, number: int, rig: RigFacts, back: MoveShaft) -> Iterator[Stage]:
    yield Rest(experiment.settle)
    yield Flap(experiment.height_m, experiment.speed_rad_s, number, rig.ramp_s, experiment.sweep_rad)
    yield back


def _check(experiment: Fatigue, number: int, back: MoveShaft) -> Iterator[Stage]:
    check = experiment.check
    angles, timing = check.angles_rad, HoldTiming(check.dwell_s, check.average_s)
    # Holds are numbered over the whole run: resuming identifies static stages by height and number.
    for place, angle_rad in enumerate(angles, start=(number - 1) * len(angles) + 1):
        yield MoveShaft(angle_rad, check.move_speed_rad_s)
        yield Hold(experiment.height_m, place, "loading", angle_rad, experiment.settle, timing)
    yield back
    yield StiffnessCheck(number, len(angles), check.drift_limit)
