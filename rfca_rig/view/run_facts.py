"""What is known of a run before it begins, as the view's process is told."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from rfca_rig.drivers.roles import SensorScale
from rfca_rig.protocol.plan import Limits, Plan
from rfca_rig.view.progress import Listed, listed
from rfca_rig.view.scenes import Scene, scenes


@dataclass(frozen=True)
class RunFacts:
    """`mark` SIM or REAL; `nominal` are the sections of the model as recordings hold them."""

    title: str
    mark: str
    stages: tuple[Listed, ...]
    scenes: tuple[Scene, ...]
    limits: Limits
    scale: SensorScale
    nominal: Mapping[str, Any]


def run_facts(plan: Plan, mark: str, scale: SensorScale, nominal: Mapping[str, Any]) -> RunFacts:
    return RunFacts(plan.title, mark, listed(plan.stages), scenes(plan), plan.limits, scale, nominal)
