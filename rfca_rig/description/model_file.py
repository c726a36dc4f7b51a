"""model.toml: a model as the sections that people write, with how well each value is known and where it came from."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

from rfca_rig.description.nominal_model import model_of
from rfca_rig.description.sections import KnownToSection, RigSections
from rfca_rig.description.toml import read_toml
from rfca_rig.description.toml_writing import comment, table, written
from rfca_rig.description.torque_rotation import with_curve_read
from rfca_rig.model.parameters import LawTable, RigModel
from rfca_rig.recording.atomic import write_atomically

SECTIONS = ("leg", "ground", "sensor", "drive")


class ModelFile(RigSections):
    """A model file: the four sections, effects, and one standard deviation of each value that was fitted or believed."""

    known_to: KnownToSection = KnownToSection()

    def model(self) -> RigModel:
        """The model that it describes."""
        return model_of(self)

    def nominal(self) -> dict[str, Any]:
        """The sections as every recording keeps them, as plain data."""
        left_out = {"known_to", *(() if self.effects else ("effects",))}
        return self.model_dump(exclude=left_out, exclude_none=True, mode="json")


@dataclass(frozen=True)
class FoundEffect:
    """An effect that was found to act: its parameters by name, or its `table`, and one standard deviation of what has one, by name."""

    id: str
    parameters: Mapping[str, float]
    std: Mapping[str, float] = field(default_factory=dict)
    table: LawTable | None = None


def read_model_file(path: Path) -> ModelFile:
    """The model in `path`; BadInput, with file and line, where it cannot be used."""
    return with_curve_read(read_toml(path, ModelFile), path.parent)


def write_model(
    path: Path, sections: Mapping[str, Any], known_to: Mapping[str, Any], comments: Iterable[str], found: Sequence[FoundEffect] = ()
) -> None:
    """Writes a model file, all or nothing, with `comments` at its head.

    `sections` holds leg, ground, sensor and drive as plain data in the file's units, and effects where some were believed already;
    `found` come behind those. Raises RigError where the disk refuses.
    """
    nominal = [_nominal(effect) for effect in sections.get("effects", ())]
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
    lines = ["[[effects]]\n", *(f"{key} = {written(value)}\n" for key, value in {"id": effect.id, **keys}.items())]
    return "".join(lines + [comment(f"{name} is known to {std:.3g}") for name, std in effect.std.items()])
