"""Reads a protocol file of any experiment into the plan for a rig."""

from collections.abc import Callable, Mapping
from pathlib import Path

from rfca_rig.description.protocol_file import read_dynamic, read_fatigue, read_static
from rfca_rig.description.toml import place_of, read_data
from rfca_rig.errors import BadInput
from rfca_rig.protocol.experiments import RigFacts, fatigue_plan, flapping_plan, static_plan
from rfca_rig.protocol.plan import Plan

PLANS: Mapping[str, Callable[[Path, RigFacts], Plan]] = {
    "dynamic": lambda path, facts: flapping_plan(read_dynamic(path).flapping(), facts),
    "static": lambda path, facts: static_plan(read_static(path).static_stages(), facts),
    "fatigue": lambda path, facts: fatigue_plan(read_fatigue(path).fatigue(), facts),
}


def read_plan(path: Path, facts: RigFacts) -> Plan:
    """The plan of the protocol in `path`. Raises BadInput, with file and line, where it cannot be used."""
    experiment = read_data(path).get("experiment")
    if not isinstance(experiment, str) or experiment not in PLANS:
        where = f"{path}" if experiment is None else place_of(path, ("experiment",))
        raise BadInput(f"{where}: experiment = {experiment!r}; a protocol says one of {', '.join(map(repr, PLANS))}")
    return PLANS[experiment](path, facts)
