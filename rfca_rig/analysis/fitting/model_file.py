"""model.toml: the fitted model as the sections that people write, with how well each value is known now, and where it came from."""

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from rfca_rig.analysis.fitting.result import FitResult, FittedParameter
from rfca_rig.description.sections import KnownToSection, RigSections
from rfca_rig.description.toml import read_toml
from rfca_rig.model.parameters import RigModel
from rfca_rig.recording.atomic import write_atomically

DIGITS = 7


class ModelFile(RigSections):
    """A model file: the four sections, and one standard deviation of each value that was fitted or believed."""

    known_to: KnownToSection = KnownToSection()


def read_model_file(path: Path) -> ModelFile:
    """The model in `path`; BadInput, with file and line, where it cannot be used."""
    return read_toml(path, ModelFile)


def write_model_file(
    path: Path, result: FitResult, believed: Mapping[str, Any], known_to: Mapping[str, Any], sources: Iterable[str]
) -> None:
    """Writes the fitted model, all or nothing; `believed` and `known_to` are the sections it began from, `sources` name the recordings.

    Raises RigError where the disk refuses.
    """
    sections = {**fitted_sections(believed, result.supposed.rig), "known_to": fitted_known_to(known_to, result)}
    comments = [f"Fitted to {source}" for source in sources] + [*result.lines(), *_outside(result)]
    text = "".join(_comment(line) for line in comments) + "".join(f"\n{_table(name, keys)}" for name, keys in sections.items())
    write_atomically(path, text.encode("utf-8"))


def fitted_sections(believed: Mapping[str, Any], rig: RigModel) -> dict[str, dict[str, Any]]:
    """The sections leg, ground, sensor, drive with the numbers of `rig`; what the model does not know is kept from `believed`."""
    leg, ground = rig.leg, rig.ground
    return {
        "leg": {
            **believed["leg"],
            "link_lengths_mm": [1e3 * length_m for length_m in leg.link_lengths_m],
            "link_masses_g": [1e3 * mass_kg for mass_kg in leg.link_masses_kg],
            "link_radius_mm": 1e3 * leg.link_radius_m,
            "k0_Nm_per_rad": leg.k0_Nm_per_rad,
            "k2_per_rad2": leg.k2_per_rad2,
            "hinge_damping_Nm_s_per_rad": leg.hinge_damping_Nm_s_per_rad,
            "start_angle_rad": leg.start_angle_rad,
        },
        "ground": {
            **believed["ground"],
            "contact_stiffness_N_per_m1p5": ground.stiffness_N_per_m1p5,
            "contact_damping_s_per_m": ground.damping_s_per_m,
            "friction_coefficient": ground.friction_coefficient,
            "presliding_mm": 1e3 * ground.presliding_m,
            "tangential_damping_N_s_per_m": ground.drag_N_s_per_m,
        },
        "sensor": {**believed["sensor"], "below_shaft_mm": 1e3 * rig.sensor.below_shaft_m},
        "drive": {**believed["drive"], "ramp_s": rig.drive.ramp_s},
    }


def fitted_known_to(known_to: Mapping[str, Any], result: FitResult) -> dict[str, float]:
    """[known_to] with the standard errors in place of what was stated before; what was not fitted stays as it was stated."""
    found = {key: float(value) for key, value in known_to.items() if value is not None}
    for fitted, parameter in zip(result.parameters, result.space.parameters, strict=True):
        if parameter.known_to is not None:
            found[parameter.known_to] = fitted.std / abs(fitted.value) if parameter.relative else fitted.std
    return found


def _outside(result: FitResult) -> list[str]:
    """What was fitted but has no place in the sections."""
    fitted = zip(result.parameters, result.space.parameters, strict=True)
    return [_remark(found) for found, parameter in fitted if found.name == "height" or parameter.known_to is None]


def _remark(fitted: FittedParameter) -> str:
    if fitted.name == "height":
        return f"The rack stood {fitted.value:+.3f} mm, known to {fitted.std:.3f} mm, from the heights stated; no section holds this."
    return f"{fitted.name} is known to {fitted.std:.3g} {fitted.unit} now; [known_to] has no key for it."


def _comment(line: str) -> str:
    """A title may hold line breaks, which would end the comment."""
    return f"# {''.join(sign if sign.isprintable() else ' ' for sign in line)}".rstrip() + "\n"


def _table(name: str, keys: Mapping[str, Any]) -> str:
    return f"[{name}]\n" + "".join(f"{key} = {_written(value)}\n" for key, value in keys.items() if value is not None)


def _written(value: Any) -> str:
    if isinstance(value, Mapping):
        return "{ " + ", ".join(f"{key} = {_written(inner)}" for key, inner in value.items() if inner is not None) + " }"
    if isinstance(value, list | tuple):
        return "[" + ", ".join(_written(inner) for inner in value) + "]"
    if isinstance(value, str):
        return '"' + value.translate(_ESCAPES) + '"'
    return _number(float(value))


_ESCAPES = {ord('"'): '\\"', ord("\\"): "\\\\", **{code: f"\\u{code:04x}" for code in (*range(32), 127)}}


def _number(value: float) -> str:
    """Enough digits for any fit; TOML wants a point or an exponent in a float, which numpy gives."""
    return str(np.format_float_scientific(value, DIGITS, trim="0") if not 1e-3 <= abs(value) < 1e5 else round(value, DIGITS))
