"""model.toml: a model in the sections of the rig file, with the uncertainty and source of each
value.

Sections of a file, in the files' units, are converted to the model's parameters in SI. A measured
torque-rotation curve stands in the section itself:

    [leg.torque_rotation]
    angles_deg = [3.0, 8.0, 14.0, 20.0]
    torques_Nm = [0.58, 1.67, 3.37, 5.80]
    standard_deviations_Nm = [0.01, 0.01, 0.02, 0.04]

Angles count from rest, where the torque is 0; that point belongs to every curve. The torques are
those of all hinges; torques_by_hinge_Nm = [[...], ...] gives each hinge its own. The standard
deviations may be left out, or replaced by covariance_Nm2 = [[...], ...]. The curve may also
be `curve = "file.csv"`, relative to the folder of the file that names it, with the columns
angle_deg, torque_Nm and, if known, torque_std_Nm. Angles that all lie on one side of rest hold for
the other side too.
"""

import csv
import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any, TypeVar

from rfca_rig.description.sections import (
    HINGE_LAW,
    LAW_KEYS,
    DriveSection,
    GroundSection,
    KnownToSection,
    LegSection,
    RigSections,
    SensorSection,
    TorqueRotationSection,
)
from rfca_rig.errors import BadInput
from rfca_rig.escaping import toml_comment
from rfca_rig.model.hinge_springs import slope_at_rest
from rfca_rig.model.parameters import (
    Drive,
    Ground,
    LawTable,
    Leg,
    RigModel,
    SensorMount,
    TorqueSpline,
)
from rfca_rig.recording.atomic import write_atomically
from rfca_rig.toml import Section, format_value, read_text, read_toml, table, validate

File = TypeVar("File", bound=Section)

COLUMNS = {
    "angle_deg": "angles_deg",
    "torque_Nm": "torques_Nm",
    "torque_std_Nm": "standard_deviations_Nm",
}


def splines_of(section: TorqueRotationSection) -> tuple[float, tuple[TorqueSpline, ...]]:
    """The stiffness at rest k0 [N m/rad], averaged over the hinges, and the curves divided by it.

    Raises BadInput where the curve is in a file that was not read.
    """
    # The model multiplies its splines by k0, so that a fit of k0 scales the whole curve.
    plain = [TorqueSpline(angles, torques) for angles, torques in section.knots()]
    k0 = sum(map(slope_at_rest, plain)) / len(plain)
    return k0, tuple(spline.scaled(1.0, 1.0 / k0) for spline in plain)


def scale_keys(keys: Mapping[str, Any], k0_Nm_per_rad: float) -> dict[str, Any]:
    """The keys of a section, with torques and their errors scaled to the given stiffness at
    rest.
    """
    factor = (
        k0_Nm_per_rad / splines_of(validate(keys, TorqueRotationSection, "leg.torque_rotation"))[0]
    )
    # A covariance scales with the square.
    powers = {
        "torques_Nm": 1,
        "torques_by_hinge_Nm": 1,
        "standard_deviations_Nm": 1,
        "covariance_Nm2": 2,
    }
    return {
        key: _times(factor ** powers.get(key, 0), value)
        for key, value in keys.items()
        if value is not None
    }


def replace_by_law(
    leg: Mapping[str, Any], k0_Nm_per_rad: float, k2_per_rad2: float
) -> dict[str, Any]:
    """The keys of [leg] with the law k0 phi + k0 k2 phi^3, without a curve."""
    others = {key: value for key, value in leg.items() if key != "torque_rotation"}
    return {**others, **dict(zip(LAW_KEYS, (HINGE_LAW, k0_Nm_per_rad, k2_per_rad2), strict=True))}


def replace_by_curve(leg: Mapping[str, Any], curve: Mapping[str, Any]) -> dict[str, Any]:
    """The keys of [leg] with the curve, without a law."""
    return {
        **{key: value for key, value in leg.items() if key not in LAW_KEYS},
        "torque_rotation": dict(curve),
    }


def _times(factor: float, value: Any) -> Any:
    if isinstance(value, list | tuple):
        return [_times(factor, item) for item in value]
    return factor * value


def read_named_curve(file: File, folder: Path) -> File:
    """The sections of a file with the curve that they name read from `folder`.

    Where [known_to] states no `k0_relative`, it becomes the curve's own band. Raises BadInput,
    naming file and line, for an invalid curve.
    """
    leg: LegSection = getattr(file, "leg")  # noqa: B009  (rig, model and campaign files all have one)
    if leg.torque_rotation is None:
        return file
    section = leg.torque_rotation
    if section.curve is not None:
        section = read_curve(folder / section.curve)
        file = file.model_copy(update={"leg": leg.model_copy(update={"torque_rotation": section})})
    known: KnownToSection = getattr(file, "known_to") or KnownToSection()  # noqa: B009
    band = relative_std(section)
    if band is None or known.k0_relative is not None:
        return file
    return file.model_copy(update={"known_to": known.model_copy(update={"k0_relative": band})})


def relative_std(section: TorqueRotationSection) -> float | None:
    """Uncertainty of a factor on the curve: rms of its band over rms of its torques; None
    without a band.
    """
    std = section.standard_deviations_Nm
    variance = [deviation**2 for deviation in std or ()] or [
        row[i] for i, row in enumerate(section.covariance_Nm2 or ())
    ]
    square = sum(torque**2 for torque in section.torques_Nm or ())
    if variance and square:
        return math.sqrt(sum(variance) / square) or None
    return None


def read_curve(path: Path) -> TorqueRotationSection:
    """Read the curve in a CSV file. Raises BadInput, naming file and line, where it cannot be
    used.
    """
    lines = [line for line in read_text(path).splitlines() if line.strip()]
    try:
        rows = list(csv.reader(lines, skipinitialspace=True))
    except csv.Error as error:
        raise BadInput(f"{path}: is no table of comma-separated numbers: {error}") from None
    names = []
    if rows:
        names = [name.strip() for name in rows[0]]
    # The band is optional.
    missing = [name for name in ("angle_deg", "torque_Nm") if name not in names]
    if missing:
        raise BadInput(
            f"{path}:1: column {missing[0]} is missing; a curve has angle_deg, torque_Nm "
            "and, if known, torque_std_Nm"
        )
    places = {key: names.index(name) for name, key in COLUMNS.items() if name in names}
    columns: dict[str, list[float]] = {}
    for key, index in places.items():
        columns[key] = [
            _number(path, line, row, index) for line, row in enumerate(rows[1:], start=2)
        ]
    # A curve that was bent to the negative side is written from rest on, with falling angles.
    if columns["angles_deg"] and columns["angles_deg"][0] > columns["angles_deg"][-1]:
        columns = {key: values[::-1] for key, values in columns.items()}
    return validate(columns, TorqueRotationSection, str(path))


def _number(path: Path, line: int, row: list[str], index: int) -> float:
    try:
        return float(row[index])
    except (ValueError, IndexError):
        if index < len(row):
            cell = repr(row[index].strip())
        else:
            cell = "nothing"
        raise BadInput(
            f"{path}:{line}: column {index + 1} should hold a number, not {cell}"
        ) from None


SECTIONS = ("leg", "ground", "sensor", "drive")


def nominal_model(sections: Mapping[str, Any]) -> RigModel:
    """The model that the sections leg, ground, sensor and drive describe.

    `sections` is plain data in the file's own units, as in `Recording.nominal`. Raises BadInput,
    naming the key, where something is missing, unknown or out of range.
    """
    return model_of(validate(sections, RigSections, "the nominal model"))


def model_of(sections: RigSections) -> RigModel:
    """The model from sections that were validated before."""
    effects = tuple(effect.present() for effect in sections.effects)
    return RigModel(
        _leg(sections.leg),
        _ground(sections.ground),
        _sensor(sections.sensor),
        _drive(sections.drive),
        effects,
    )


def _leg(leg: LegSection) -> Leg:
    if leg.torque_rotation is None:
        assert leg.k0_Nm_per_rad is not None
        assert leg.k2_per_rad2 is not None
        k0_Nm_per_rad = leg.k0_Nm_per_rad
        k2_per_rad2 = leg.k2_per_rad2
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
    friction_lever_m = None
    if ground.friction_lever_mm is not None:
        friction_lever_m = ground.friction_lever_mm / 1e3
    return Ground(
        stiffness_N_per_m1p5=ground.contact_stiffness_N_per_m1p5,
        damping_s_per_m=ground.contact_damping_s_per_m,
        friction_coefficient=ground.friction_coefficient,
        presliding_m=ground.presliding_mm / 1e3,
        drag_N_s_per_m=ground.tangential_damping_N_s_per_m,
        friction_lever_m=friction_lever_m,
        friction_rise_share=ground.friction_rise_share,
        leaving_damping_share=ground.leaving_damping_share,
    )


def _sensor(sensor: SensorSection) -> SensorMount:
    return SensorMount(below_shaft_m=sensor.below_shaft_mm / 1e3)


def _drive(drive: DriveSection) -> Drive:
    return Drive(ramp_s=drive.ramp_s, holds_start=drive.holds_start)


class ModelFile(RigSections):
    """A model file: the four sections, effects, and one standard deviation of each value that
    was fitted or nominal.
    """

    known_to: KnownToSection = KnownToSection()

    def model(self) -> RigModel:
        """The model that it describes."""
        return model_of(self)

    def nominal(self) -> dict[str, Any]:
        """The sections as plain data, in the form of a recording."""
        excluded = {"known_to"}
        if not self.effects:
            excluded.add("effects")
        return self.model_dump(exclude=excluded, exclude_none=True, mode="json")


@dataclass(frozen=True)
class FoundEffect:
    """An identified effect: its parameters by name, or its `table`, and standard deviations by
    name where known.
    """

    id: str
    parameters: Mapping[str, float]
    std: Mapping[str, float] = field(default_factory=dict)
    table: LawTable | None = None


def read_model_file(path: Path) -> ModelFile:
    """Read the model in `path`. Raises BadInput, with file and line, where it cannot be used."""
    return read_named_curve(read_toml(path, ModelFile), path.parent)


def write_model(
    path: Path,
    sections: Mapping[str, Any],
    known_to: Mapping[str, Any],
    comments: Iterable[str],
    found: Sequence[FoundEffect] = (),
) -> None:
    """Write a model file, all or nothing.

    Parameters
    ----------
    path
        File to write.
    sections
        leg, ground, sensor and drive as plain data in the file's units, and the effects of the
        nominal model.
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
    # A table inside [leg] must follow all plain keys of [leg], so it is written as a table of its
    # own.
    curve = sections["leg"].get("torque_rotation")
    leg = {key: value for key, value in sections["leg"].items() if key != "torque_rotation"}
    named: dict[str, Mapping[str, Any]] = {"leg": leg}
    if curve is not None:
        named["leg.torque_rotation"] = curve
    named |= {name: sections[name] for name in SECTIONS if name != "leg"}
    named["known_to"] = known_to
    tables = [table(name, keys) for name, keys in named.items()]
    parts = [
        "".join(toml_comment(line) for line in comments),
        *tables,
        *(_effect(effect) for effect in (*nominal, *found)),
    ]
    write_atomically(path, "\n".join(parts).encode("utf-8"))


def _nominal(effect: Mapping[str, Any]) -> FoundEffect:
    if "knots" not in effect:
        return FoundEffect(effect["id"], effect["parameters"])
    table = LawTable(
        effect["place"], effect["argument"], tuple(effect["knots"]), tuple(effect["values"])
    )
    return FoundEffect(effect["id"], {}, table=table)


def _effect(effect: FoundEffect) -> str:
    if effect.table is None:
        keys = {"parameters": effect.parameters}
    else:
        keys = asdict(effect.table)
    lines = [
        "[[effects]]\n",
        *(f"{key} = {format_value(value)}\n" for key, value in {"id": effect.id, **keys}.items()),
    ]
    return "".join(
        lines + [toml_comment(f"{name} is known to {std:.3g}") for name, std in effect.std.items()]
    )
