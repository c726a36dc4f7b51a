"""A plan as text and back: what a run keeps of it is enough to go on with exactly the same plan."""

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

_KINDS: dict[str, type] = {kind.__name__: kind for kind in (SetHeight, MoveShaft, Rest, Approach, Flap, Hold, Cycles, StiffnessCheck)}


def plan_texts(plan: Plan) -> dict[str, str]:
    """The plan as it was resolved, by name: its stages in their order, its limits and rates as JSON, and which experiment it is."""
    stages = [{"stage": type(stage).__name__, "label": stage.label, **_fields(stage)} for stage in plan.stages]
    return {
        "plan": json.dumps(stages),
        "limits": json.dumps(asdict(plan.limits)),
        "rates": json.dumps(asdict(plan.rates)),
        "experiment": plan.experiment,
    }


def _fields(stage: Stage) -> dict[str, Any]:
    return asdict(stage)  # type: ignore[call-overload, no-any-return]


def plan_of(title: str, texts: Mapping[str, str]) -> Plan:
    """The plan of which `plan_texts` gave the texts. Raises BadInput where they are not such, or of another version."""
    try:
        stages = tuple(cast(Stage, _rebuilt(_KINDS[said["stage"]], said)) for said in json.loads(texts["plan"]))
        limits, rates = (_rebuilt(kind, json.loads(texts[name])) for kind, name in ((Limits, "limits"), (Rates, "rates")))
        if texts["experiment"] not in get_args(Experiment):
            raise ValueError(f"experiment {texts['experiment']!r}")
        return Plan(title, cast(Experiment, texts["experiment"]), stages, limits, rates)
    except (LookupError, TypeError, ValueError) as error:
        raise BadInput(f"its plan cannot be read, perhaps because another version wrote it: {type(error).__name__}: {error}") from None


def _rebuilt(kind: type, said: Mapping[str, Any]) -> Any:
    """An object of a frozen dataclass from its fields by name; other names are passed over."""
    hints = get_type_hints(kind)
    values = {field.name: said[field.name] for field in fields(kind)}
    return kind(**{name: _rebuilt(hints[name], value) if is_dataclass(hints[name]) else value for name, value in values.items()})
