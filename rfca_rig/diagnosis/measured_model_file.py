"""The model with a measured law in it as a file, for `predict`, `report --model` and the next diagnosis."""

from dataclasses import replace
from pathlib import Path

from rfca_rig.analysis.fitting.model_file import fitted_sections
from rfca_rig.description.model_file import FoundEffect, write_model
from rfca_rig.diagnosis.fitted_model_file import refine_known_to
from rfca_rig.diagnosis.residual_force.law import MeasuredLaw
from rfca_rig.diagnosis.result_builder import nuisance_values
from rfca_rig.model.tabulated_law import TABULATED_LAW
from rfca_rig.recording.form import Recording


def write_measured_model(path: Path, law: MeasuredLaw, recording: Recording) -> None:
    """Writes the model as fitted beside the law, the effects of its base, and the law as [[effects]] id = "tabulated_law".

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
    fitted = law.hypothesis.fitted
    supposed = fitted.coordinates.supposed(law.hypothesis.judgement.posterior.mean)
    base = replace(supposed.rig, effects=supposed.rig.effects[:-1])
    table = law.present.table
    std = {f"the value at {knot:.4g}": float(value) for knot, value in zip(law.knots, law.std, strict=True)}
    comments = [
        f"A law of {law.argument} at {law.place}, measured beside {' with '.join(law.base) or 'nothing missing'}",
        f"It takes away {100.0 * law.explained:.0f} % of the misfit on held-out conditions",
    ]
    known_to = refine_known_to(nuisance_values(law.hypothesis), recording)
    sections = fitted_sections(recording.believed, base, supposed.height_offset_m)
    write_model(path, sections, known_to, comments, [FoundEffect(TABULATED_LAW, {}, std, table)])
