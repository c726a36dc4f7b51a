"""What the twin of a run was concealing, and whether a diagnosis found it."""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from rfca_rig.errors import BadInput

if TYPE_CHECKING:
    from rfca_rig.diagnosis.problem import Problem
    from rfca_rig.diagnosis.result import Diagnosis
    from rfca_rig.model.parameters import PresentEffect

RIG_FILE = "rig_file"  # key of a run's provenance


def open_concealed(problem: "Problem") -> "tuple[PresentEffect, ...]":
    """The effects that the twins of these recordings concealed, each once.

    Raises BadInput where there is none, or the seal is damaged.
    """
    from rfca_rig.bench.concealment import open_seal
    from rfca_rig.description.rig_file import RigFile
    from rfca_rig.diagnosis.leg.problem import LegProblem
    from rfca_rig.toml import model_of

    concealed: dict[PresentEffect, None] = {}
    recordings = problem.recordings_of_leg if isinstance(problem, LegProblem) else ()
    for recording in recordings:
        text = recording.provenance.get(RIG_FILE, "")
        twin = model_of(text, RigFile, Path(recording.title)).twin if text else None
        if twin is not None:
            concealed |= dict.fromkeys(open_seal(twin.concealed))
    if not concealed:
        raise BadInput(
            "--reveal: the twin of these recordings conceals nothing; rfca-rig twin conceal FILE "
            "writes a rig file of a twin that does"
        )
    return tuple(concealed)


def describe_reveal(concealed: "Sequence[PresentEffect]", diagnosis: "Diagnosis") -> list[str]:
    """A line for each concealed effect with its sizes, and whether it was found."""
    ids = {effect.id for effect in concealed}
    return [
        f"concealed: {_name(effect)}: {_judge(effect.id, ids, diagnosis)}" for effect in concealed
    ]


def _name(effect: "PresentEffect") -> str:
    from rfca_rig.model.catalogue import catalogue

    declared = {parameter.name for parameter in catalogue()[effect.id].parameters}
    sizes = [f"{name} {value:.3g}" for name, value in effect.values if name in declared]
    return f"{effect.id}, {', '.join(sizes)}"


def _judge(effect_id: str, concealed: set[str], diagnosis: "Diagnosis") -> str:
    stated = {effect.id for effect in diagnosis.effects}
    alternatives = {other for effect in diagnosis.effects for other in effect.cannot_tell_from}
    family = set(diagnosis.family.members) if diagnosis.family is not None else set()
    if effect_id in stated:
        others = stated - concealed
        if others:
            return f"found, beside {', '.join(sorted(others))}, which the twin does not have"
        return "found"
    if effect_id in alternatives:
        return f"stated as {', '.join(sorted(stated))}, which these data cannot tell from it"
    if effect_id in family:
        return "of the stated family"
    if stated or family:
        return "WRONG: something else is stated"
    return "not found, and nothing else is stated"
