"""Fits the curve of one form to the stages: touching ends, errors and coefficients are found together."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rfca_rig.analysis.torque_rotation.active_contacts import Ends, find_pressing_ends, guess_contacts, make_start_point, solve_contacts
from rfca_rig.analysis.torque_rotation.balance import Balance
from rfca_rig.analysis.torque_rotation.bases import Basis
from rfca_rig.analysis.torque_rotation.gauss_helmert import Adjustment, Point
from rfca_rig.analysis.torque_rotation.noise import Errors, estimate_noise
from rfca_rig.analysis.torque_rotation.stages import StageData
from rfca_rig.analysis.torque_rotation.systematics import SystematicErrors
from rfca_rig.model.hinge_springs import bending_torque_Nm
from rfca_rig.model.parameters import RigModel

Floats = NDArray[np.float64]

MAX_ROUNDS = 4
# Change of the logarithm of a noise below which it counts as the same.
LOG_TOLERANCE = 0.02


@dataclass(frozen=True)
class CurveFit:
    """A curve with the errors it was found with; `log_likelihood` is that of the errors, `ends` (S,) are those that touch."""

    adjusted: Adjustment
    errors: Errors
    log_likelihood: float
    ends: tuple[Ends, ...]


def fit_curve(
    data: StageData,
    rig: RigModel,
    basis: Basis,
    systematic_errors: SystematicErrors,
    errors: Errors,
    extra: Floats | None = None,
    learn: bool = True,
) -> CurveFit:
    """Fit the coefficients by least squares with errors in all measured values.

    Parameters
    ----------
    data, rig
        The stages and the nominal model.
    basis
        Form of the curve.
    systematic_errors
        Their priors.
    errors
        Noise to begin from.
    extra
        (S, h, e) further columns of hinge torque.
    learn
        Whether the noise is estimated from the stages.

    Raises
    ------
    SimulationFailed
        Where no balance is found.
    """
    nothing = np.zeros((len(data.measured), data.hinges, 0))
    balance = Balance(rig, basis, systematic_errors, nothing if extra is None else extra)
    p = np.zeros(balance.curve_size + len(systematic_errors.each))
    # Gauss-Newton begins at the nominal curve, with all systematic errors at 0.
    p[: basis.size] = _nominal_curve(rig, basis, data)
    ends = guess_contacts(balance, data, p)
    point = make_start_point(balance, data, Point(data.measured.copy(), (), p), ends)
    for _ in range(MAX_ROUNDS):
        adjusted, ends = solve_contacts(balance, data, errors.covariance(data, rig.leg.link_lengths_m), point, ends)
        if not learn:
            return CurveFit(adjusted, errors, adjusted.log_likelihood, find_pressing_ends(adjusted, len(ends)))
        # Noise and curve depend on each other, so both are estimated in turn until the noise no longer changes.
        before, (errors, likelihood) = errors, estimate_noise(data, adjusted, errors)
        point = adjusted.point
        if _is_same(before, errors):
            break
    adjusted, ends = solve_contacts(balance, data, errors.covariance(data, rig.leg.link_lengths_m), point, ends)
    return CurveFit(adjusted, errors, likelihood, find_pressing_ends(adjusted, len(ends)))


def _nominal_curve(rig: RigModel, basis: Basis, data: StageData) -> Floats:
    """Coefficients nearest to the nominal law over the angles of the stages, (size,)."""
    phi = np.linspace(*_range(data), 100)
    torque = bending_torque_Nm(rig.leg, phi)
    return np.asarray(np.linalg.lstsq(basis.columns(phi), torque, rcond=None)[0])


def _range(data: StageData) -> tuple[float, float]:
    angles = data.measured[:, : data.hinges][data.seen]
    return float(angles.min()), float(angles.max())


def _is_same(a: Errors, b: Errors) -> bool:
    pairs = ((a.hinge_std_rad, b.hinge_std_rad), (a.stated_factor, b.stated_factor), (a.force_factor, b.force_factor))
    return max(abs(float(np.log(x / y))) for x, y in pairs) < LOG_TOLERANCE
