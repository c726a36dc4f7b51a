"""Estimates the force at the tip from the hinge angles of a photograph: eq. (10) solved by SVD. Symbols as in `statics`."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rfca_rig.errors import BadInput
from rfca_rig.model.statics import TipChain, tangent_stiffness, tip_jacobian, weight_torques_Nm

Floats = NDArray[np.float64]

REFINEMENTS = 30
REFINED_N = 1e-9


@dataclass(frozen=True)
class TipForceEstimate:
    """Estimate of the tip force with its uncertainty: `force_N` (2,) along and down.

    `singular_values` (2,) of the matrix that was inverted, largest first, and their ratio; `standard_errors_N` (2,) and
    `covariance_N2` (2, 2) that follow from the noise of the angles to first order; `residual_Nm` (n - 1,) of the hinge moments.
    """

    force_N: Floats
    singular_values: Floats
    condition_number: float
    covariance_N2: Floats
    residual_Nm: Floats

    @property
    def standard_errors_N(self) -> Floats:
        return np.asarray(np.sqrt(np.diag(self.covariance_N2)))


def tip_force(chain: TipChain, phi: Floats, angle_noise_rad: float) -> TipForceEstimate:
    """Tip force by least squares of the hinge moments: J^T F = K(phi) - weight.

    Joint 1 gives no equation, because its moment is the unknown torque of the drive.

    Parameters
    ----------
    chain
        The leg; the weight of its links is subtracted, other than in the paper.
    phi
        (n,) shaft and hinge angles [rad].
    angle_noise_rad
        Standard deviation of each hinge angle.

    Raises
    ------
    BadInput
        Where fewer than two hinges, or hinges all in line with the tip, do not determine the force.

    References
    ----------
    Equation (10), solved by singular value decomposition.
    """
    return _estimate(chain, phi, angle_noise_rad, np.eye(phi.size - 1))


def tip_force_weighing_angles(chain: TipChain, phi: Floats, angle_noise_rad: float) -> TipForceEstimate:
    """As `tip_force` with joint angles `phi` (n,), each moment weighted by its error: the estimate of least variance.

    Errors of the hinge moments are K_t times errors of the angles, K_t the tangent stiffness under load. Multiplied by its
    inverse, (10) yields the force whose shape is nearest to the photograph. K_t contains the force, so the estimate is iterated.
    """
    estimate = tip_force(chain, phi, angle_noise_rad)
    for _ in range(REFINEMENTS):
        before = estimate.force_N
        weights = np.asarray(np.linalg.inv(tangent_stiffness(chain, phi, before)[1:, 1:]), dtype=np.float64)
        estimate = _estimate(chain, phi, angle_noise_rad, weights)
        if np.abs(estimate.force_N - before).max() < REFINED_N:
            break
    return estimate


def _estimate(chain: TipChain, phi: Floats, angle_noise_rad: float, weights: Floats) -> TipForceEstimate:
    B = tip_jacobian(chain, phi)[:, 1:].T
    moments = (chain.springs.torque_Nm(phi) - weight_torques_Nm(chain, phi))[1:]
    # Two singular values are needed for two components; a ratio of 1e-9 is rounding.
    U, s, Vt = np.linalg.svd(weights @ B, full_matrices=False)
    if len(s) < 2 or s[1] < 1e-9 * s[0]:
        raise BadInput(f"{len(moments)} hinge angles do not determine the two parts of the tip force; at least two hinges must bend apart")
    pseudo_inverse = Vt.T / s @ U.T @ weights
    force = pseudo_inverse @ moments
    # An angle error dphi changes the moments by K_t dphi, and the pseudo-inverse turns those into a change of the force.
    spread = pseudo_inverse @ tangent_stiffness(chain, phi, force)[1:, 1:] * angle_noise_rad
    return TipForceEstimate(force, s, float(s[0] / s[1]), spread @ spread.T, moments - B @ force)
