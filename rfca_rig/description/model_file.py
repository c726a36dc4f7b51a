"""model.toml: a model in the sections of the rig file, with the uncertainty and source of each value."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

from rfca_rig.description.nominal_model import model_of
from rfca_rig.description.sections import KnownToSection, RigSections
from rfca_rig.description.toml import read_toml
from rfca_rig.description.toml_writing import comment, format_value, table
from rfca_rig.description.torque_rotation import read_named_curve
from rfca_rig.model.parameters import LawTable, RigModel
from rfca_rig.recording.atomic import write_atomically

SECTIONS = ("leg", "ground", "sensor", "drive")


class ModelFile(RigSections):
    """A model file: the four sections, effects, and one standard deviation of each value that was fitted or nominal."""

    known_to: KnownToSection = KnownToSection()

    def model(self) -> RigModel:
        """The model that it describes."""
        return model_of(self)

    def nominal(self) -> dict[str, Any]:
        """The sections as plain data, in the form of a recording."""
        left_out = {"known_to", *(() if self.effects else ("effects",))}
        return self.model_dump(exclude=left_out, exclude_none=True, mode="json")


@dataclass(frozen=True)
class FoundEffect:
    """An identified effect: its parameters by name, or its `table`, and standard deviations by name where known."""

    id: str
    parameters: Mapping[str, float]
    std: Mapping[str, float] = field(default_factory=dict)
    table: LawTable | None = None


def read_model_file(path: Path) -> ModelFile:
    """Read the model in `path`. Raises BadInput, with file and line, where it cannot be used."""
    return read_named_curve(read_toml(path, ModelFile), path.parent)


def write_model(
    path: Path, sections: Mapping[str, Any], known_to: Mapping[str, Any], comments: Iterable[str], found: Sequence[FoundEffect] = ()
) -> None:
    """Write a model file, all or nothing.

    Parameters
    ----------
    path
        File to write.
    sections
        leg, ground, sensor and drive as plain data in the file's units, and the effects of the nominal model.
    known_to
        Standard deviations by key.
    comments
        Lines at the head of the file.
    found
        Identified effects, written after those of the nominal model.

    Raises
    ------
    RigError
        Where the disk refuses.
    """
    nominal = [_nominal(effect) for effect in sections.get("effects", ())]
    # A table inside [leg] must follow all plain keys of [leg], so it is written as a table of its own.
    curve = sections["leg"].get("torque_rotation")
    leg = {key: value for key, value in sections["leg"].items() if key != "torque_rotation"}
    curves = {} if curve is None else {"leg.torque_rotation": curve}
    named = {"leg": leg, **curves, **{name: sections[name] for name in SECTIONS if name != "leg"}, "known_to": known_to}
    tables = [table(name, keys) for name, keys in named.items()]
    parts = ["".join(comment(line) for line in comments), *tables, *(_effect(effect) for effect in (*nominal, *found))]
    write_atomically(path, "\n".join(parts).encode("utf-8"))


def _nominal(effect: Mapping[str, Any]) -> FoundEffect:
    if "knots" not in effect:
        return FoundEffect(effect["id"], effect["parameters"])
    table = LawTable(effect["place"], effect["argument"], tuple(effect["knots"]), tuple(effect["values"]))
    return FoundEffect(effect["id"], {}, table=table)


def _effect(effect: FoundEffect) -> str:
    keys = {"parameters": effect.parameters} if effect.table is None else asdict(effect.table)
    lines = ["[[effects]]\n", *(f"{key} = {format_value(value)}\n" for key, value in {"id": effect.id, **keys}.items())]
    return "".join(lines + [comment(f"{name} is known to {std:.3g}") for name, std in effect.std.items()])
