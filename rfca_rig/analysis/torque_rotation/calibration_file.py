"""Writes the fitted hinges as model files for --model: one with k0 and k2, one with the measured
curve.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rfca_rig.analysis.fitting.result import make_fitted_sections
from rfca_rig.analysis.torque_rotation.bases import SplineThroughRest
from rfca_rig.analysis.torque_rotation.checks import FormCheck, RestAngles
from rfca_rig.analysis.torque_rotation.static_result import StaticResult, remarks
from rfca_rig.description.model_file import (
    nominal_model,
    relative_std,
    replace_by_curve,
    replace_by_law,
    write_model,
)
from rfca_rig.description.sections import MIN_K2_PER_RAD2, TorqueRotationSection
from rfca_rig.model.parameters import RigModel

# Significant digits; the covariance itself is known far less well.
COVARIANCE_DIGITS = 6


def can_be_written(result: StaticResult) -> bool:
    """Whether the law grows up to 90 degrees, as a model file requires."""
    return result.values.k0_Nm_per_rad > 0.0 and result.values.k2_per_rad2 >= MIN_K2_PER_RAD2


def can_curve_be_written(result: StaticResult) -> bool:
    """Whether the curve grows everywhere, as a model file requires."""
    return not result.not_monotone


def write_calibration(
    path: Path,
    result: StaticResult,
    nominal: Mapping[str, Any],
    known_to: Mapping[str, Any],
    sources: Sequence[str],
) -> None:
    """Write the nominal model with the fitted k0, k2 and rest angles, and their new uncertainties;
    all or nothing.

    The uncertainties hold the distance of the law from the measured curve. Raises RigError where
    the disk refuses.
    """
    values = result.values
    rests = result.rests[0]
    leg = replace_by_law(nominal["leg"], values.k0_Nm_per_rad, values.k2_per_rad2)
    sections = _sections({**nominal, "leg": leg}, result.rig, rests)
    fitted = result.values
    low, high = (abs(np.degrees(angle)) for angle in sorted(result.curve.range_rad, key=abs))
    write_model(
        path,
        sections,
        _keep_stated(known_to) | result.values.known_to | _rest_known_to(rests),
        [
            *_from(sources),
            f"k0 {fitted.k0_Nm_per_rad:.4f} +- {fitted.reach * fitted.k0_std:.4f} N "
            f"m/rad, k2 {fitted.k2_per_rad2:.4f} +- "
            f"{fitted.reach * fitted.k2_std:.4f} 1/rad2 (95 %), "
            f"errors correlated by {fitted.correlation:+.2f}; from {low:.1f} to {high:.1f} degrees",
            *_of_rests(result.rests[0]),
            *remarks(result),
        ],
    )


def write_curve(
    path: Path,
    result: StaticResult,
    nominal: Mapping[str, Any],
    known_to: Mapping[str, Any],
    sources: Sequence[str],
) -> None:
    """Write the nominal model with the measured curve and its covariance in place of k0 and k2; all
    or nothing.

    `k0_relative` is the root mean square of the curve's band over that of its torques: how far a
    fit may scale the curve. The band holds the distance of the curve from splines with a torque at
    rest. Raises RigError where the disk refuses.
    """
    keys = curve_keys(result)
    rests = result.rests[1]
    band = relative_std(TorqueRotationSection.model_validate(keys))
    sections = _sections(
        {**nominal, "leg": replace_by_curve(nominal["leg"], keys)}, result.rig, rests
    )
    # The curve has no k2; its scale takes the key k0_relative.
    known = {
        key: value
        for key, value in _keep_stated(known_to).items()
        if key not in ("k0_relative", "k2_relative")
    }
    known["k0_relative"] = band or 0.0
    low, high = (abs(np.degrees(angle)) for angle in sorted(result.model.range_rad, key=abs))
    write_model(
        path,
        sections,
        known | _rest_known_to(rests),
        [
            *_from(sources),
            (
                f"A cubic spline through rest, measured from {low:.1f} to {high:.1f} degrees; "
                "straight beyond the last angle"
            ),
            *_of_rests(result.rests[1]),
            *_of_form(result.model_form),
            *remarks(result),
        ],
    )


def curve_keys(result: StaticResult) -> dict[str, Any]:
    """The keys of [leg.torque_rotation] for the measured curve."""
    basis = result.model.basis
    covariance = result.model.covariance
    # The form for a model is always a spline through rest; the assertion tells the type checker.
    assert isinstance(basis, SplineThroughRest)
    # Rounding and least squares leave tiny asymmetries, which the section would refuse; the mean
    # with the transpose removes them.
    symmetric = 0.5 * (covariance + covariance.T)
    return {
        "angles_deg": np.degrees(basis.knots_rad).tolist(),
        "torques_Nm": result.model.coefficients.tolist(),
        "covariance_Nm2": [_round_covariances(row) for row in symmetric],
    }


def _round_covariances(row: NDArray[np.float64]) -> list[float]:
    """A row of the covariance (k,) with the digits that the file holds."""
    return [float(f"{value:.{COVARIANCE_DIGITS}g}") for value in row]


def _sections(
    nominal: Mapping[str, Any], rig: RigModel, rests: RestAngles | None
) -> dict[str, Any]:
    leg = nominal_model(nominal).leg
    if rests is not None:
        leg = replace(leg, rest_angles_rad=tuple(rests.rest_rad.tolist()))
    return make_fitted_sections(nominal, replace(rig, leg=leg))


def _keep_stated(known_to: Mapping[str, Any]) -> dict[str, float]:
    return {key: float(value) for key, value in known_to.items() if value is not None}


def _rest_known_to(rests: RestAngles | None) -> dict[str, float]:
    """One number for all hinges: the largest of them."""
    if rests is None:
        return {}
    return {"rest_angle_deg": float(np.degrees(rests.std_rad.max()))}


def _from(sources: Sequence[str]) -> list[str]:
    return [
        f"Torque over rotation of the hinges, from the static stages of {source}"
        for source in sources
    ]


def _of_form(form: FormCheck) -> list[str]:
    if form.holds:
        return []
    return [
        "splines that need not pass through rest part from it by "
        f"{abs(form.apart_Nm):.2f} N m, {abs(100 * form.apart_relative):.1f} % of "
        f"the largest torque, at {abs(np.degrees(form.at_rad)):.0f} degrees"
    ]


def _of_rests(rests: RestAngles | None) -> list[str]:
    if rests is None:
        return []
    deviations = ", ".join(f"{np.degrees(std):.3f}" for std in rests.std_rad)
    return [
        f"rest angles known to {deviations} degrees, their mean to "
        f"{np.degrees(rests.common_std_rad):.3f}, "
        f"correlated by {rests.with_stiffness:+.2f} with the stiffness at rest"
    ]
