"""Model files of a leg, with the effects found or with a measured law: for `predict`, for
`report --model` and for the next diagnosis.
"""

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

from rfca_rig.analysis.fitting.parameters import PARAMETERS
from rfca_rig.analysis.fitting.result import make_fitted_sections
from rfca_rig.description.model_file import FoundEffect, write_model
from rfca_rig.diagnosis.residual_force.law import MeasuredLaw
from rfca_rig.diagnosis.result import Diagnosis, NamedEffect, Value
from rfca_rig.diagnosis.result_builder import nuisance_values
from rfca_rig.model.declarations.changes import VALUE_OF_CHANGE
from rfca_rig.model.declarations.ground import HEIGHT_OFFSET
from rfca_rig.model.tabulated_law import TABULATED_LAW
from rfca_rig.recording.model import Recording


def write_fitted_model(path: Path, diagnosis: Diagnosis, recording: Recording) -> bool:
    """Writes the nominal model with fitted values and the effects found.

    Parameters
    ----------
    path
        Of the model file; it is replaced whole, or removed where neither an effect nor a change was
        found.
    diagnosis
        Of a leg.
    recording
        One of those diagnosed, for the sections as they were stated.

    Returns
    -------
    bool
        Whether there is a file.

    Raises
    ------
    RigError
        Where the disk refuses.
    """
    has_changes = any(effect.id in VALUE_OF_CHANGE for effect in diagnosis.effects)
    if not (diagnosis.found_effects or has_changes):
        path.unlink(missing_ok=True)
        return False
    rig = diagnosis.found_rig
    # The effects found are the last of the rig. They have entries of their own in the file.
    sections = make_fitted_sections(
        recording.nominal,
        replace(rig, effects=rig.effects[: len(rig.effects) - len(diagnosis.found_effects)]),
    )
    if rig.drive.holds_start:
        sections["drive"] = {**sections["drive"], "holds_start": True}
    # A height offset beyond its uncertainty means that the rack stood elsewhere, which the model
    # file states as an effect.
    # A value that has changed stands in its section.
    effects = [
        _to_found_effect(effect) for effect in diagnosis.effects if effect.id not in VALUE_OF_CHANGE
    ]
    height = diagnosis.believed_values.get("height")
    if (
        height
        and abs(height.value) >= height.std
        and all(effect.id != HEIGHT_OFFSET.id for effect in effects)
    ):
        effects.append(
            FoundEffect(HEIGHT_OFFSET.id, {"offset_mm": height.value}, {"offset_mm": height.std})
        )  # the rack stood elsewhere
    comments = [f"Diagnosed from {diagnosis.title}", diagnosis.sentence]
    write_model(
        path, sections, _refine_known_to(diagnosis.believed_values, recording), comments, effects
    )
    return True


def write_measured_model(path: Path, law: MeasuredLaw, recording: Recording) -> None:
    """Write the model as fitted beside the law, the effects of its base, and the law as [[effects]]
    id = "tabulated_law".

    Parameters
    ----------
    path
        Of the model file; it is replaced whole.
    law
        The law, as `measure_law` gives it; of a leg, not of a pendulum.
    recording
        One of those that it was measured on, for the sections as they were stated.

    Raises
    ------
    RigError
        Where the disk refuses.
    """
    supposed = law.hypothesis.fitted.coordinates.supposed(law.hypothesis.marginal.posterior.mean)
    # The law is the last effect of the fit; it is written with its table, so it must not appear
    # twice.
    base = replace(supposed.rig, effects=supposed.rig.effects[:-1])
    std = {
        f"the value at {knot:.4g}": float(value)
        for knot, value in zip(law.knots, law.std, strict=True)
    }
    comments = [
        (
            f"A law of {law.argument} at {law.place}, measured beside "
            f"{' with '.join(law.base) or 'nothing missing'}"
        ),
        f"It takes away {100.0 * law.explained:.0f} % of the misfit on held-out conditions",
    ]
    known_to = _refine_known_to(nuisance_values(law.hypothesis), recording)
    sections = make_fitted_sections(recording.nominal, base, supposed.height_offset_m)
    write_model(
        path, sections, known_to, comments, [FoundEffect(TABULATED_LAW, {}, std, law.present.table)]
    )


def _to_found_effect(effect: NamedEffect) -> FoundEffect:
    parameters = {**effect.parameters, **effect.shape}
    values = {name: value.value for name, value in parameters.items()}
    return FoundEffect(
        effect.id, values, {name: value.std for name, value in parameters.items() if value.std}
    )


def _refine_known_to(values: Mapping[str, Value], recording: Recording) -> Mapping[str, float]:
    """[known_to] after the fit; a value that was not fitted keeps its stated uncertainty."""
    known = {key: float(value) for key, value in recording.known_to.items() if value is not None}
    for name, value in values.items():
        parameter = PARAMETERS.get(name)
        if parameter is not None and parameter.known_to in known and value.std > 0.0:
            if parameter.relative:
                known[parameter.known_to] = value.std / abs(value.value)
            else:
                known[parameter.known_to] = value.std
    return known
