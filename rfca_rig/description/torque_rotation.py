"""A measured torque-rotation curve in a file, and its conversion to the model's springs.

    [leg.torque_rotation]
    angles_deg = [3.0, 8.0, 14.0, 20.0]                  # from rest, where the torque is 0; that point belongs to every curve
    torques_Nm = [0.58, 1.67, 3.37, 5.80]                # of all hinges; or torques_by_hinge_Nm = [[...], ...]
    standard_deviations_Nm = [0.01, 0.01, 0.02, 0.04]    # may be left out; or covariance_Nm2 = [[...], ...]

or `curve = "file.csv"`, relative to the folder of the file that names it, with the columns angle_deg, torque_Nm and, if known,
torque_std_Nm. Angles that all lie on one side of rest hold for the other side too.
"""

import csv
import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any, TypeVar

from rfca_rig.description.sections import HINGE_LAW, LAW_KEYS, KnownToSection, LegSection, Section, TorqueRotationSection
from rfca_rig.description.toml import read_text, validate
from rfca_rig.errors import BadInput
from rfca_rig.model.hinge_springs import slope_at_rest
from rfca_rig.model.parameters import TorqueSpline

File = TypeVar("File", bound=Section)

COLUMNS = {"angle_deg": "angles_deg", "torque_Nm": "torques_Nm", "torque_std_Nm": "standard_deviations_Nm"}


def splines_of(section: TorqueRotationSection) -> tuple[float, tuple[TorqueSpline, ...]]:
    """The stiffness at rest k0 [N m/rad], averaged over the hinges, and the curves divided by it.

    Raises BadInput where the curve is in a file that was not read.
    """
    # The model multiplies its splines by k0, so that a fit of k0 scales the whole curve.
    plain = [TorqueSpline(angles, torques) for angles, torques in section.knots()]
    k0 = sum(map(slope_at_rest, plain)) / len(plain)
    return k0, tuple(spline.scaled(1.0, 1.0 / k0) for spline in plain)


def scale_keys(keys: Mapping[str, Any], k0_Nm_per_rad: float) -> dict[str, Any]:
    """The keys of a section, with torques and their errors scaled to the given stiffness at rest."""
    factor = k0_Nm_per_rad / splines_of(validate(keys, TorqueRotationSection, "leg.torque_rotation"))[0]
    # A covariance scales with the square.
    powers = {"torques_Nm": 1, "torques_by_hinge_Nm": 1, "standard_deviations_Nm": 1, "covariance_Nm2": 2}
    return {key: _times(factor ** powers.get(key, 0), value) for key, value in keys.items() if value is not None}


def replace_by_law(leg: Mapping[str, Any], k0_Nm_per_rad: float, k2_per_rad2: float) -> dict[str, Any]:
    """The keys of [leg] with the law k0 phi + k0 k2 phi^3, without a curve."""
    others = {key: value for key, value in leg.items() if key != "torque_rotation"}
    return {**others, **dict(zip(LAW_KEYS, (HINGE_LAW, k0_Nm_per_rad, k2_per_rad2), strict=True))}


def replace_by_curve(leg: Mapping[str, Any], curve: Mapping[str, Any]) -> dict[str, Any]:
    """The keys of [leg] with the curve, without a law."""
    return {**{key: value for key, value in leg.items() if key not in LAW_KEYS}, "torque_rotation": dict(curve)}


def _times(factor: float, value: Any) -> Any:
    return [_times(factor, each) for each in value] if isinstance(value, list | tuple) else factor * value


def read_named_curve(file: File, folder: Path) -> File:
    """The sections of a file with the curve that they name read from `folder`.

    Where [known_to] states no `k0_relative`, it becomes the curve's own band. Raises BadInput, naming file and line, for an invalid curve.
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
    """Uncertainty of a factor on the curve: rms of its band over rms of its torques; None without a band."""
    std = section.standard_deviations_Nm
    variance = [each**2 for each in std or ()] or [row[i] for i, row in enumerate(section.covariance_Nm2 or ())]
    square = sum(torque**2 for torque in section.torques_Nm or ())
    return math.sqrt(sum(variance) / square) or None if variance and square else None


def read_curve(path: Path) -> TorqueRotationSection:
    """Read the curve in a CSV file. Raises BadInput, naming file and line, where it cannot be used."""
    lines = [line for line in read_text(path).splitlines() if line.strip()]
    try:
        rows = list(csv.reader(lines, skipinitialspace=True))
    except csv.Error as error:
        raise BadInput(f"{path}: is no table of comma-separated numbers: {error}") from None
    names = [name.strip() for name in rows[0]] if rows else []
    # The band is optional.
    missing = [name for name in ("angle_deg", "torque_Nm") if name not in names]
    if missing:
        raise BadInput(f"{path}:1: column {missing[0]} is missing; a curve has angle_deg, torque_Nm and, if known, torque_std_Nm")
    places = {key: names.index(name) for name, key in COLUMNS.items() if name in names}
    columns: dict[str, list[float]] = {
        key: [_number(path, line, row, place) for line, row in enumerate(rows[1:], start=2)] for key, place in places.items()
    }
    # A curve that was bent to the negative side is written from rest on, with falling angles.
    if columns["angles_deg"] and columns["angles_deg"][0] > columns["angles_deg"][-1]:
        columns = {key: values[::-1] for key, values in columns.items()}
    return validate(columns, TorqueRotationSection, str(path))


def _number(path: Path, line: int, row: list[str], place: int) -> float:
    try:
        return float(row[place])
    except (ValueError, IndexError):
        cell = repr(row[place].strip()) if place < len(row) else "nothing"
        raise BadInput(f"{path}:{line}: column {place + 1} should hold a number, not {cell}") from None
