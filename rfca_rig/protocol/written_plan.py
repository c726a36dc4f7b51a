"""A plan as text and back: what a run stores of it is enough to continue with exactly the same
plan.

The rest of a stopped plan: nothing is recorded twice, and nothing is omitted.
"""

import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import MISSING, asdict, dataclass, fields, is_dataclass, replace
from typing import Any, cast, get_args, get_type_hints

from rfca_rig.errors import BadInput
from rfca_rig.protocol.plan import (
    Approach,
    Cycles,
    Experiment,
    Flap,
    Hold,
    Limits,
    MoveShaft,
    Plan,
    Rates,
    Rest,
    SetHeight,
    Stage,
    StiffnessCheck,
)

# The stages that a stored plan may name: no other class is ever made from a file's text.
_KINDS: dict[str, type] = {
    kind.__name__: kind
    for kind in (SetHeight, MoveShaft, Rest, Approach, Flap, Hold, Cycles, StiffnessCheck)
}


def serialize_plan(plan: Plan) -> dict[str, str]:
    """The plan as text by name: its stages in order, its limits and rates as JSON, and the kind
    of experiment.
    """
    stages = [
        {"stage": type(stage).__name__, "label": stage.label, **_fields(stage)}
        for stage in plan.stages
    ]
    return {
        "plan": json.dumps(stages),
        "limits": json.dumps(asdict(plan.limits)),
        "rates": json.dumps(asdict(plan.rates)),
        "experiment": plan.experiment,
    }


def _fields(stage: Stage) -> dict[str, Any]:
    return asdict(stage)  # type: ignore[call-overload, no-any-return]


def parse_plan(title: str, texts: Mapping[str, str]) -> Plan:
    """The plan that `serialize_plan` wrote. Raises BadInput where the texts are not valid, or of
    another version.
    """
    try:
        stages = tuple(
            cast(Stage, _from_fields(_KINDS[fields_of_stage["stage"]], fields_of_stage))
            for fields_of_stage in json.loads(texts["plan"])
        )
        limits, rates = (
            _from_fields(kind, json.loads(texts[name]))
            for kind, name in ((Limits, "limits"), (Rates, "rates"))
        )
        if texts["experiment"] not in get_args(Experiment):
            raise ValueError(f"experiment {texts['experiment']!r}")
        return Plan(title, cast(Experiment, texts["experiment"]), stages, limits, rates)
    except (LookupError, TypeError, ValueError) as error:
        raise BadInput(
            "its plan cannot be read, perhaps because another version wrote it: "
            f"{type(error).__name__}: {error}"
        ) from None


def _from_fields(kind: type, values_by_name: Mapping[str, Any]) -> Any:
    """An object of a frozen dataclass from its fields by name; other names are ignored."""
    hints = get_type_hints(kind)
    # Names that are ignored, for example `label`, are there for people who read the file. A field
    # with a default may be missing: an earlier version did not have it.
    stored = [
        field.name
        for field in fields(kind)
        if field.name in values_by_name or field.default is MISSING
    ]
    values = {name: values_by_name[name] for name in stored}
    return kind(
        **{
            name: _from_fields(hints[name], value) if is_dataclass(hints[name]) else value
            for name, value in values.items()
        }
    )


@dataclass(frozen=True)
class PlanProgress:
    """How far a plan got: recorded strokes and static stages, and the number of the last cycle,
    0 for none.
    """

    strokes: int = 0
    holds: int = 0
    cycle: int = 0


def make_remaining_plan(plan: Plan, done: PlanProgress) -> Plan:
    """The plan from its first unrecorded stage on; without any stage where all are recorded.

    1. The rack is set again, because the motor is off meanwhile.
    2. From wherever the shaft stands, perhaps in mid-stroke on the ground, it turns forwards to the
       start angle: pushed backwards, a bent leg wedges.
    3. A static stage depends on the way to it, so the moves since the start angle are repeated,
       without the recorded stages.

    Raises BadInput where the plan does not begin with the stages in `done`.
    """
    stages = tuple(plan.stages)
    first_open = _first_open(stages, done)
    if first_open is None:
        return replace(plan, stages=())
    # The last setting of the rack before it: heights that are finished are not set again.
    rack = max(
        number for number, stage in enumerate(stages[:first_open]) if isinstance(stage, SetHeight)
    )
    on_the_way = stages[rack + 1 : first_open]
    part = _open_part(stages[first_open], done)
    return replace(
        plan, stages=(stages[rack], *_way_there(on_the_way, part), part, *stages[first_open + 1 :])
    )


def _first_open(stages: Sequence[Stage], done: PlanProgress) -> int | None:
    """Index of the first stage to be recorded that is not; None where all are."""
    strokes_left = done.strokes
    holds_left = done.holds
    cycle = 0
    open_index = None
    for index, stage in enumerate(stages):
        match stage:
            case Flap() if strokes_left:
                strokes_left -= 1
            case Hold() if holds_left:
                holds_left -= 1
            # Cycles are counted one by one: a block may be recorded in part.
            case Cycles() if stage.last <= done.cycle:
                cycle = stage.last
            case Flap() | Hold() | Cycles():
                open_index = index
                if isinstance(stage, Cycles) and stage.first <= done.cycle:
                    cycle = done.cycle
                break
    # More is recorded than the plan has before this stage: it is another plan's recording.
    if strokes_left or holds_left or cycle != done.cycle:
        raise BadInput(
            f"{done.strokes} strokes, {done.holds} static stages and {done.cycle} cycles "
            "are not what the plan begins with"
        )
    return open_index


def _way_there(led: Sequence[Stage], to_come: Stage) -> Iterator[Stage]:
    """Stages that lead to `to_come`, the first unrecorded one; `led` are those between the rack
    and it.
    """
    home = next((stage for stage in led if isinstance(stage, MoveShaft)), None)
    if home is None:
        return
    yield replace(home, forwards=True)
    yield from _first_strokes(led, to_come)
    # From the last visit of the start angle on: only these moves decide the state of a static
    # stage.
    last_home = max(
        index
        for index, stage in enumerate(led)
        if isinstance(stage, MoveShaft) and stage.angle_rad == home.angle_rad
    )
    yield from (
        stage
        for stage in led[last_home + 1 :]
        if not isinstance(stage, Approach | Flap | Hold | Cycles)
    )


def _first_strokes(led: Sequence[Stage], to_come: Stage) -> Iterator[Stage]:
    """First strokes of the condition again, each with its rest and its way back: the rig may
    have changed meanwhile.
    """
    for index, stage in enumerate(led):
        if isinstance(stage, Approach) and stage.full_speed_rad_s == getattr(
            to_come, "speed_rad_s", None
        ):
            # The plan puts a rest before each first stroke and the way home behind it.
            yield from led[index - 1 : index + 2]


def _open_part(stage: Stage, done: PlanProgress) -> Stage:
    """The stage; of cycles only those that were not counted."""
    if not isinstance(stage, Cycles):
        return stage
    first = max(stage.first, done.cycle + 1)
    return replace(stage, first=first, count=stage.last - first + 1)
