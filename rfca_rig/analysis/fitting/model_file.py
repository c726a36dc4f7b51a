"""Writes a fitted model as a model file: fitted values, their new uncertainties, and the sources of the fit."""

import math
from collections.abc import Iterable, Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any

from rfca_rig.analysis.fitting.result import FitResult, FittedParameter
from rfca_rig.description.model_file import write_model
from rfca_rig.description.torque_rotation import scale_keys
from rfca_rig.model.parameters import RigModel

HEIGHT_OFFSET = "height_offset"


def write_model_file(
    path: Path, result: FitResult, nominal: Mapping[str, Any], known_to: Mapping[str, Any], sources: Iterable[str]
) -> None:
    """Write the fitted model, all or nothing.

    Parameters
    ----------
    path
        File to write.
    result
        The fit.
    nominal, known_to
        Sections that the fit began from.
    sources
        Names of the recordings.

    Raises
    ------
    RigError
        Where the disk refuses.
    """
    supposed = result.supposed
    sections = make_fitted_sections(nominal, supposed.rig, supposed.height_offset_m)
    comments = [*(f"Fitted to {source}" for source in sources), *result.lines(), *_remarks(result)]
    write_model(path, sections, make_fitted_known_to(known_to, result), comments)


def make_fitted_sections(nominal: Mapping[str, Any], rig: RigModel, height_offset_m: float = 0.0) -> dict[str, Any]:
    """The sections leg, ground, sensor, drive and effects with the numbers of `rig`; values outside the model are kept from `nominal`.

    A rack that stands higher than stated is written as an effect.
    """
    leg, ground = rig.leg, rig.ground
    return {
        # Nominal keys come first: those without a counterpart in the model are kept.
        "leg": {
            **nominal["leg"],
            "link_lengths_mm": [1e3 * length_m for length_m in leg.link_lengths_m],
            "link_masses_g": [1e3 * mass_kg for mass_kg in leg.link_masses_kg],
            "link_radius_mm": 1e3 * leg.link_radius_m,
            # k0 and k2, or the curve multiplied by the fitted factor.
            **(
                {"torque_rotation": scale_keys(nominal["leg"]["torque_rotation"], leg.k0_Nm_per_rad)}
                if leg.torque_splines
                else {"k0_Nm_per_rad": leg.k0_Nm_per_rad, "k2_per_rad2": leg.k2_per_rad2}
            ),
            "hinge_damping_Nm_s_per_rad": leg.hinge_damping_Nm_s_per_rad,
            "start_angle_rad": leg.start_angle_rad,
            **({"rest_angles_deg": [math.degrees(rest_rad) for rest_rad in leg.rest_angles_rad]} if leg.rest_angles_rad else {}),
        },
        "ground": {
            **nominal["ground"],
            "contact_stiffness_N_per_m1p5": ground.stiffness_N_per_m1p5,
            "contact_damping_s_per_m": ground.damping_s_per_m,
            "friction_coefficient": ground.friction_coefficient,
            "presliding_mm": 1e3 * ground.presliding_m,
            "tangential_damping_N_s_per_m": ground.drag_N_s_per_m,
            **({} if ground.friction_lever_m is None else {"friction_lever_mm": 1e3 * ground.friction_lever_m}),
            "friction_rise_share": ground.friction_rise_share,
            "leaving_damping_share": ground.leaving_damping_share,
        },
        "sensor": {**nominal["sensor"], "below_shaft_mm": 1e3 * rig.sensor.below_shaft_m},
        "drive": {**nominal["drive"], "ramp_s": rig.drive.ramp_s},
        "effects": _effects(rig, 1e3 * height_offset_m),
    }


def _effects(rig: RigModel, offset_mm: float) -> list[dict[str, Any]]:
    """The effects of the rig; a height offset is added to one that the nominal model already has."""
    effects = [
        {"id": present.id, "parameters": dict(present.values), **({} if present.table is None else asdict(present.table))}
        for present in rig.effects
    ]
    if not offset_mm:
        return effects
    # The nominal model already contains this offset, so the fitted one is added to it.
    nominal_mm = sum(dict(present.values)["offset_mm"] for present in rig.effects if present.id == HEIGHT_OFFSET)
    others = [effect for effect in effects if effect["id"] != HEIGHT_OFFSET]
    return [*others, {"id": HEIGHT_OFFSET, "parameters": {"offset_mm": nominal_mm + offset_mm}}]


def make_fitted_known_to(known_to: Mapping[str, Any], result: FitResult) -> dict[str, float]:
    """[known_to] with the standard errors of the fit in place of the values stated before; others stay as stated."""
    found = {key: float(value) for key, value in known_to.items() if value is not None}
    for fitted, parameter in zip(result.parameters, result.space.parameters, strict=True):
        if parameter.known_to is not None:
            # Keys of relative parameters are shares of the value.
            found[parameter.known_to] = fitted.std / abs(fitted.value) if parameter.relative else fitted.std
    return found


def _remarks(result: FitResult) -> list[str]:
    """Comments on fitted parameters that have no key in the sections."""
    fitted = zip(result.parameters, result.space.parameters, strict=True)
    return [_remark(found) for found, parameter in fitted if found.name == "height" or parameter.known_to is None]


def _remark(fitted: FittedParameter) -> str:
    if fitted.name == "height":
        return f"The rack stood {fitted.value:+.3f} mm, known to {fitted.std:.3f} mm, from the heights stated: effect {HEIGHT_OFFSET}."
    return f"{fitted.name} is known to {fitted.std:.3g} {fitted.unit} now; [known_to] has no key for it."
