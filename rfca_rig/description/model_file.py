"""model.toml: a model in the sections of the rig file, with the uncertainty and source of each value.

Sections of a file, in the files' units, are converted to the model's parameters in SI.
"""

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

from rfca_rig.description.sections import DriveSection, GroundSection, KnownToSection, LegSection, RigSections, SensorSection
from rfca_rig.description.toml import comment, format_value, read_toml, table, validate
from rfca_rig.description.torque_rotation import read_named_curve, splines_of
from rfca_rig.model.parameters import Drive, Ground, LawTable, Leg, RigModel, SensorMount, TorqueSpline
from rfca_rig.recording.atomic import write_atomically

SECTIONS = ("leg", "ground", "sensor", "drive")


def nominal_model(sections: Mapping[str, Any]) -> RigModel:
    """The model that the sections leg, ground, sensor and drive describe.

    `sections` is plain data in the file's own units, as in `Recording.nominal`. Raises BadInput, naming the key, where something is
    missing, unknown or out of range.
    """
    return model_of(validate(sections, RigSections, "the nominal model"))


def model_of(sections: RigSections) -> RigModel:
    """The model from sections that were validated before."""
    effects = tuple(effect.present() for effect in sections.effects)
    return RigModel(_leg(sections.leg), _ground(sections.ground), _sensor(sections.sensor), _drive(sections.drive), effects)


def _leg(leg: LegSection) -> Leg:
    if leg.torque_rotation is None:
        assert leg.k0_Nm_per_rad is not None
        assert leg.k2_per_rad2 is not None
        k0_Nm_per_rad, k2_per_rad2 = leg.k0_Nm_per_rad, leg.k2_per_rad2
        splines: tuple[TorqueSpline, ...] = ()
    else:
        # The hardening is part of the measured curve; k0 only scales it.
        k2_per_rad2 = 0.0
        k0_Nm_per_rad, splines = splines_of(leg.torque_rotation)
    return Leg(
        link_lengths_m=tuple(length_mm / 1e3 for length_mm in leg.link_lengths_mm),
        link_masses_kg=tuple(mass_g / 1e3 for mass_g in leg.link_masses_g),
        link_radius_m=leg.link_radius_mm / 1e3,
        k0_Nm_per_rad=k0_Nm_per_rad,
        k2_per_rad2=k2_per_rad2,
        hinge_damping_Nm_s_per_rad=leg.hinge_damping_Nm_s_per_rad,
        start_angle_rad=leg.start_angle_rad,
        rest_angles_rad=tuple(map(math.radians, leg.rest_angles_deg or ())),
        torque_splines=splines,
    )


def _ground(ground: GroundSection) -> Ground:
    return Ground(
        stiffness_N_per_m1p5=ground.contact_stiffness_N_per_m1p5,
        damping_s_per_m=ground.contact_damping_s_per_m,
        friction_coefficient=ground.friction_coefficient,
        presliding_m=ground.presliding_mm / 1e3,
        drag_N_s_per_m=ground.tangential_damping_N_s_per_m,
        friction_lever_m=None if ground.friction_lever_mm is None else ground.friction_lever_mm / 1e3,
        friction_rise_share=ground.friction_rise_share,
        leaving_damping_share=ground.leaving_damping_share,
    )


def _sensor(sensor: SensorSection) -> SensorMount:
    return SensorMount(below_shaft_m=sensor.below_shaft_mm / 1e3)


def _drive(drive: DriveSection) -> Drive:
    return Drive(ramp_s=drive.ramp_s, holds_start=drive.holds_start)


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
