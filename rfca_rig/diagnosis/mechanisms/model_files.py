"""Files with which users of a mechanism go on: its model with what is stated, a measured law."""

from collections.abc import Mapping, Sequence
from pathlib import Path

from rfca_rig.diagnosis.residual_force.law import MeasuredLaw
from rfca_rig.diagnosis.result import Diagnosis
from rfca_rig.escaping import csv_line
from rfca_rig.mechanism.laws_file import write_laws
from rfca_rig.mechanism.model_files import write_amended_model
from rfca_rig.mechanism.plant import Plant
from rfca_rig.model.effect import Effect
from rfca_rig.recording.atomic import write_atomically


def write_plant(
    plant: Plant, folder: Path, model_name: str, laws_name: str, stated: Sequence[str]
) -> Sequence[str]:
    """Write the model file, and Python functions for what MJCF cannot express; see `FileWriter`."""
    beyond = write_amended_model(plant, folder / model_name)
    if write_laws(plant, beyond, folder / laws_name, stated, model_name):
        return (
            f"{folder / model_name}: MJCF does not hold {', '.join(beyond)}; "
            f"{folder / laws_name} does, for your own loop",
        )
    return ()


def describe_effects(result: Diagnosis, effects: Mapping[str, Effect]) -> tuple[str, ...]:
    """The stated effects with formulas, sources and values."""
    lines = []
    for named in result.effects:
        effect = effects[named.id]
        lines += [
            f"{named.id}: {named.left_out}",
            f"    law: {effect.law}",
            f"    source: {effect.source}",
        ]
        lines += [
            f"    {name} = {value.value:.4g} +- {value.std:.2g}"
            for name, value in {**named.parameters, **named.shape}.items()
        ]
    return tuple(lines)


def write_law_table(path: Path, law: MeasuredLaw) -> None:
    """Writes knots, values and standard deviations as CSV, and the whole law where the model has a
    part of it already.

    Raises RigError where the file cannot be written.
    """
    unit = law.unit.replace(" ", "") or "relative"
    columns = {
        law.argument: law.knots,
        f"residual_{unit}": law.values,
        f"residual_std_{unit}": law.std,
    }
    if law.whole is not None and law.whole_std is not None:
        columns |= {f"whole_{unit}": law.whole, f"whole_std_{unit}": law.whole_std}
    lines = [csv_line(columns)]
    for row in zip(*columns.values(), strict=True):
        lines.append(csv_line(f"{value:.7g}" for value in row))
    write_atomically(path, "".join(lines).encode("utf-8"))
