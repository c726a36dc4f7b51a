"""What is known of a run before it begins, as sent to the view's process."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from rfca_rig.drivers.roles import SensorScale
from rfca_rig.protocol.plan import Limits, Plan
from rfca_rig.view.progress import ListedStage, list_stages
from rfca_rig.view.scenes import Scene, scenes


@dataclass(frozen=True)
class RunFacts:
    """Facts of a run. `mark` is SIM or REAL; `nominal` holds the sections of the nominal model as in recordings."""

    title: str
    mark: str
    stages: tuple[ListedStage, ...]
    scenes: tuple[Scene, ...]
    limits: Limits
    scale: SensorScale
    nominal: Mapping[str, Any]


def run_facts(plan: Plan, mark: str, scale: SensorScale, nominal: Mapping[str, Any]) -> RunFacts:
    """Facts of a run of `plan`.

    Parameters
    ----------
    plan
        The plan to be carried out.
    mark
        SIM for twins, REAL for a rig.
    scale
        Counts of the force sensor per N and N m.
    nominal
        Sections of the nominal model as in recordings.
    """
    return RunFacts(plan.title, mark, list_stages(plan.stages), scenes(plan), plan.limits, scale, nominal)
