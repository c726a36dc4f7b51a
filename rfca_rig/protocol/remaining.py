"""What is left of a plan that was stopped: nothing recorded twice, nothing left out, and the leg never pushed backwards."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

from rfca_rig.errors import BadInput
from rfca_rig.protocol.cycles import Cycles
from rfca_rig.protocol.plan import Approach, Flap, Hold, MoveShaft, Plan, SetHeight, Stage


@dataclass(frozen=True)
class Done:
    """How far a plan got: how many strokes and static stages are recorded, and the number of the last cycle, 0 for none."""

    strokes: int = 0
    holds: int = 0
    cycle: int = 0


def remaining(plan: Plan, done: Done) -> Plan:
    """The plan from its first stage on that was not recorded; without any stage where all were.

    The rack is set up anew, for the motor is off meanwhile. From wherever the shaft stands, perhaps in mid-stroke on the ground, it turns
    forwards to the start angle: pushed backwards, a bent leg wedges. What a static stage shows depends on the way to it, so the moves since
    the start angle are gone through again, without the stages that are recorded. Raises BadInput where the plan does not begin with
    what is said to be done.
    """
    stages = tuple(plan.stages)
    place = _first_open(stages, done)
    if place is None:
        return replace(plan, stages=())
    rack = max(number for number, stage in enumerate(stages[:place]) if isinstance(stage, SetHeight))
    led, part = stages[rack + 1 : place], _open_part(stages[place], done)
    return replace(plan, stages=(stages[rack], *_way_there(led, part), part, *stages[place + 1 :]))


def _first_open(stages: Sequence[Stage], done: Done) -> int | None:
    """The place of the first stage to be recorded that is not; None where all are."""
    strokes, holds, cycle = done.strokes, done.holds, 0
    found = None
    for place, stage in enumerate(stages):
        match stage:
            case Flap() if strokes:
                strokes -= 1
            case Hold() if holds:
                holds -= 1
            case Cycles() if stage.last <= done.cycle:
                cycle = stage.last
            case Flap() | Hold() | Cycles():
                found = place
                cycle = done.cycle if isinstance(stage, Cycles) and stage.first <= done.cycle else cycle
                break
    if strokes or holds or cycle != done.cycle:
        raise BadInput(f"{done.strokes} strokes, {done.holds} static stages and {done.cycle} cycles are not what the plan begins with")
    return found


def _way_there(led: Sequence[Stage], to_come: Stage) -> Iterator[Stage]:
    """`led` are the stages between the rack and `to_come`, the first that is not recorded."""
    home = next((stage for stage in led if isinstance(stage, MoveShaft)), None)
    if home is None:
        return
    yield replace(home, forwards=True)
    yield from _first_strokes(led, to_come)
    last_home = max(place for place, stage in enumerate(led) if isinstance(stage, MoveShaft) and stage.angle_rad == home.angle_rad)
    yield from (stage for stage in led[last_home + 1 :] if not isinstance(stage, Approach | Flap | Hold | Cycles))


def _first_strokes(led: Sequence[Stage], to_come: Stage) -> Iterator[Stage]:
    """Those of the condition again, each with its rest and its way back: who knows what happened to the rig meanwhile."""
    for place, stage in enumerate(led):
        if isinstance(stage, Approach) and stage.full_speed_rad_s == getattr(to_come, "speed_rad_s", None):
            yield from led[place - 1 : place + 2]


def _open_part(stage: Stage, done: Done) -> Stage:
    """The stage, of cycles those that were not counted."""
    if not isinstance(stage, Cycles):
        return stage
    first = max(stage.first, done.cycle + 1)
    return replace(stage, first=first, count=stage.last - first + 1)
