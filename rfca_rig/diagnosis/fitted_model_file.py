"""The accepted model as a file: the sections as believed, with what was fitted, and the effects that were found."""

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from rfca_rig.analysis.fitting.model_file import fitted_sections
from rfca_rig.analysis.fitting.parameters import PARAMETERS
from rfca_rig.description.model_file import FoundEffect, write_model
from rfca_rig.diagnosis.result import Diagnosis, NamedEffect, Value
from rfca_rig.recording.form import Recording

HEIGHT_OFFSET = "height_offset"


def write_fitted_model(path: Path, diagnosis: Diagnosis, recording: Recording) -> bool:
    """Writes the model with the named effects; False, and no file, where none was named. Raises RigError where the disk refuses."""
    if not diagnosis.found_effects:
        path.unlink(missing_ok=True)
        return False
    rig = diagnosis.found_rig
    before = replace(rig, effects=rig.effects[: len(rig.effects) - len(diagnosis.found_effects)])
    sections: dict[str, Any] = dict(fitted_sections(recording.believed, before))
    if diagnosis.found_rig.drive.holds_start:
        sections["drive"] = {**sections["drive"], "holds_start": True}
    comments = [f"Diagnosed from {diagnosis.title}", diagnosis.sentence]
    write_model(path, sections, refine_known_to(diagnosis.believed_values, recording), comments, _effects(diagnosis))
    return True


def _effects(diagnosis: Diagnosis) -> list[FoundEffect]:
    """The named ones, and the rack where it stood elsewhere than stated."""
    found = [_found(effect) for effect in diagnosis.effects]
    height = diagnosis.believed_values.get("height")
    if height is None or abs(height.value) < height.std or any(effect.id == HEIGHT_OFFSET for effect in found):
        return found
    return [*found, FoundEffect(HEIGHT_OFFSET, {"offset_mm": height.value}, {"offset_mm": height.std})]


def _found(effect: NamedEffect) -> FoundEffect:
    found = {**effect.parameters, **effect.shape}
    values = {name: value.value for name, value in found.items()}
    return FoundEffect(effect.id, values, {name: value.std for name, value in found.items() if value.std})


def refine_known_to(values: Mapping[str, Value], recording: Recording) -> Mapping[str, float]:
    """[known_to] with what is known now; what was not fitted stays as it was stated."""
    known = {key: float(value) for key, value in recording.known_to.items() if value is not None}
    for name, value in values.items():
        parameter = PARAMETERS.get(name)
        if parameter is not None and parameter.known_to in known and value.std > 0.0:
            known[parameter.known_to] = value.std / abs(value.value) if parameter.relative else value.std
    return known
