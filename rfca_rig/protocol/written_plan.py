"""A plan as text and back: what a run stores of it is enough to continue with exactly the same plan."""

import json
from collections.abc import Mapping
from dataclasses import asdict, fields, is_dataclass
from typing import Any, cast, get_args, get_type_hints

from rfca_rig.errors import BadInput
from rfca_rig.protocol.cycles import Cycles, StiffnessCheck
from rfca_rig.protocol.plan import (
    Approach,
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
)

# The stages that a stored plan may name: no other class is ever made from a file's text.
_KINDS: dict[str, type] = {kind.__name__: kind for kind in (SetHeight, MoveShaft, Rest, Approach, Flap, Hold, Cycles, StiffnessCheck)}


def serialize_plan(plan: Plan) -> dict[str, str]:
    """The plan as text by name: its stages in order, its limits and rates as JSON, and the kind of experiment."""
    stages = [{"stage": type(stage).__name__, "label": stage.label, **_fields(stage)} for stage in plan.stages]
    return {
        "plan": json.dumps(stages),
        "limits": json.dumps(asdict(plan.limits)),
        "rates": json.dumps(asdict(plan.rates)),
        "experiment": plan.experiment,
    }


def _fields(stage: Stage) -> dict[str, Any]:
    return asdict(stage)  # type: ignore[call-overload, no-any-return]


def parse_plan(title: str, texts: Mapping[str, str]) -> Plan:
    """The plan that `serialize_plan` wrote. Raises BadInput where the texts are not valid, or of another version."""
    try:
        stages = tuple(
            cast(Stage, _from_fields(_KINDS[fields_of_stage["stage"]], fields_of_stage)) for fields_of_stage in json.loads(texts["plan"])
        )
        limits, rates = (_from_fields(kind, json.loads(texts[name])) for kind, name in ((Limits, "limits"), (Rates, "rates")))
        if texts["experiment"] not in get_args(Experiment):
            raise ValueError(f"experiment {texts['experiment']!r}")
        return Plan(title, cast(Experiment, texts["experiment"]), stages, limits, rates)
    except (LookupError, TypeError, ValueError) as error:
        raise BadInput(f"its plan cannot be read, perhaps because another version wrote it: {type(error).__name__}: {error}") from None


def _from_fields(kind: type, values_by_name: Mapping[str, Any]) -> Any:
    """An object of a frozen dataclass from its fields by name; other names are ignored."""
    hints = get_type_hints(kind)
    # Names that are ignored, for example `label`, are there for people who read the file.
    values = {field.name: values_by_name[field.name] for field in fields(kind)}
    return kind(**{name: _from_fields(hints[name], value) if is_dataclass(hints[name]) else value for name, value in values.items()})
