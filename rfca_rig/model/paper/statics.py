"""Kinematics and equilibrium of the chain under a force at its tip: section III.B, eqs. (9)-(10).

Symbols of the paper: phi_i angle of joint i (phi_1 the shaft, phi_2.. the hinges), varphi_k = phi_1
+ .. + phi_k absolute angle of link k, L_i its length; x along the ground and y downwards, so that
angles count from x towards y. Positions and forces are pairs (along, down). Two misprints are
corrected: the matrix printed in (10) must be the transpose of J of (9), 7 x 2, since otherwise its
product with (F_x, F_y) is not defined; and its alpha_i is the varphi_i of (9). Joint 1 has no
spring: there k_1 phi_1 stands for the torque of the drive.

`tip_force` estimates the force at the tip from the hinge angles of a photograph: eq. (10) solved by
SVD.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rfca_rig.errors import BadInput, SimulationFailed
from rfca_rig.model.hinge_springs import HingeSprings, springs_of
from rfca_rig.model.parameters import GRAVITY_M_S2, Leg

Floats = NDArray[np.float64]

NEWTON_LIMIT = 15
CONVERGED_RAD = 1e-12
# Of a hinge within one load step, so that Newton stays on the branch that begins at no load.
FARTHEST_TURN_RAD = 0.3
SMALLEST_LOAD_STEP = 1e-5

REFINEMENTS = 30
REFINED_N = 1e-9


@dataclass(frozen=True)
class TipChain:
    """The leg in the statics: `L` (n,) [m], `mass` (n,) [kg], springs, and the radius of the tip's
    circle [m].

    The force acts at the lowest point of that circle, as on the ground; the paper has radius 0.
    """

    L: Floats
    mass: Floats
    springs: HingeSprings
    tip_radius_m: float = 0.0
    gravity_m_s2: float = GRAVITY_M_S2

    @property
    def first_moment(self) -> Floats:
        """First moment of each link about its joint, with the links beyond it at its end (n,)
        [kg m].
        """
        beyond = np.cumsum(self.mass[::-1])[::-1] - self.mass
        return np.asarray(self.L * (0.5 * self.mass + beyond))


@dataclass(frozen=True)
class TipEquilibrium:
    """`phi` (n,) joint angles [rad]; the torque that holds the shaft; whether the equilibrium of
    the hinges is stable.
    """

    phi: Floats
    shaft_torque_Nm: float
    stable: bool


def tip_chain_of(leg: Leg) -> TipChain:
    """The leg of a rig, whose tip is the end circle of its last link."""
    return TipChain(
        np.array(leg.link_lengths_m),
        np.array(leg.link_masses_kg),
        springs_of(leg),
        leg.link_radius_m,
    )


def absolute_angles(phi: Floats) -> Floats:
    """Absolute angles varphi_k (n,) of joint angles `phi` (n,) [rad], first line of (9)."""
    return np.asarray(np.cumsum(phi))


def tip_place_m(chain: TipChain, phi: Floats) -> Floats:
    """Place (2,) of the tip, x along and y down [m], for joint angles `phi` (n,), eq. (9)."""
    varphi = absolute_angles(phi)
    return np.array([chain.L @ np.cos(varphi), chain.L @ np.sin(varphi)])


def tip_jacobian(chain: TipChain, phi: Floats) -> Floats:
    """Jacobian J (2, n) of eq. (9) at joint angles `phi` (n,): derivative of the point where the
    force acts, along and down [m/rad].

    The circle's lowest point rolls back by its radius with every joint that turns the last link.
    """
    varphi = absolute_angles(phi)
    along = sum_to_tip(-chain.L * np.sin(varphi))
    down = sum_to_tip(chain.L * np.cos(varphi))
    return np.array([along - chain.tip_radius_m, down])


def sum_to_tip(per_link: Floats) -> Floats:
    """Sums (n,) of a quantity per link (n,) from each link to the tip, as in (10)."""
    return np.asarray(np.cumsum(per_link[::-1])[::-1])


def weight_torques_Nm(chain: TipChain, phi: Floats) -> Floats:
    """Torque (n,) [N m] of the weight of all links from each joint on, at joint angles `phi`
    (n,).
    """
    return sum_to_tip(chain.gravity_m_s2 * chain.first_moment * np.cos(absolute_angles(phi)))


def imbalance_Nm(
    chain: TipChain, phi: Floats, force_N: Floats, weight_share: float = 1.0
) -> Floats:
    """Torques of the springs less those of weight and tip force, J^T F.

    Parameters
    ----------
    chain
        The leg.
    phi
        (n,) joint angles [rad].
    force_N
        (2,) along and down on the tip; a ground that pushes up is negative in its second place.
    weight_share
        Factor on the weight.

    Returns
    -------
    (n,) [N m], zero at every hinge in equilibrium; at joint 1 the torque that holds the shaft.

    References
    ----------
    Equation (10).
    """
    load = weight_share * weight_torques_Nm(chain, phi) + tip_jacobian(chain, phi).T @ force_N
    return np.asarray(chain.springs.torque_Nm(phi) - load)


def tangent_stiffness(
    chain: TipChain, phi: Floats, force_N: Floats, weight_share: float = 1.0
) -> Floats:
    """Derivative (n, n) [N m/rad] of `imbalance_Nm` by `phi` (n,): K_i on the diagonal, and the
    geometric stiffness of the loads.

    `force_N` (2,) acts along and down on the tip.
    """
    varphi = absolute_angles(phi)
    weight = -weight_share * chain.gravity_m_s2 * chain.first_moment * np.sin(varphi)
    tip = -chain.L * (force_N[0] * np.cos(varphi) + force_N[1] * np.sin(varphi))
    joints = np.arange(phi.size)
    # A load on link k depends on all joints up to k, so entry (i, j) is the sum from the later of
    # both joints on.
    geometric = sum_to_tip(weight + tip)[np.maximum(joints[:, None], joints[None, :])]
    return np.asarray(np.diag(chain.springs.stiffness_Nm_per_rad(phi)) - geometric)


def equilibrium_under_tip_force(
    chain: TipChain, shaft_angle_rad: float, force_N: Floats
) -> TipEquilibrium:
    """Shape of the leg with the shaft held and a given force on the tip, weight included.

    Weight and force grow together from the straight chain, in steps that are halved where Newton
    does not converge nearby.

    Parameters
    ----------
    chain
        The leg.
    shaft_angle_rad
        Angle of the shaft from the horizontal, downwards.
    force_N
        (2,) along and down on the tip.

    Returns
    -------
    TipEquilibrium
        On the branch that begins without load.

    Raises
    ------
    SimulationFailed
        Where no equilibrium continues the branch; it names the share of the load that was reached.

    References
    ----------
    Equations (9) and (10).
    """
    phi = np.zeros(chain.L.size)
    phi[0] = shaft_angle_rad
    carried = 0.0
    step = 0.25
    while carried < 1.0:
        share = min(1.0, carried + step)
        loaded = _newton(chain, phi, share * force_N, share)
        if loaded is not None:
            phi = loaded
            carried = share
            step = 2.0 * step
        else:
            step *= 0.5
        if step < SMALLEST_LOAD_STEP:
            raise SimulationFailed(
                f"no equilibrium found beyond {100.0 * carried:.1f} % of weight and tip force "
                f"({force_N[0]:.1f} N along, {force_N[1]:.1f} N down), "
                f"shaft at {np.degrees(shaft_angle_rad):.1f} degrees; use a smaller "
                "force, or look for a slipped decimal point in the leg"
            )
    # A minimum of the potential energy in the hinge angles, since the shaft is held.
    hinges = tangent_stiffness(chain, phi, force_N)[1:, 1:]
    return TipEquilibrium(
        phi,
        float(imbalance_Nm(chain, phi, force_N)[0]),
        bool(np.all(np.linalg.eigvalsh(hinges) > 0.0)),
    )


def _newton(chain: TipChain, phi: Floats, force_N: Floats, weight_share: float) -> Floats | None:
    angles = phi.copy()
    for _ in range(NEWTON_LIMIT):
        stiffness = tangent_stiffness(chain, angles, force_N, weight_share)[1:, 1:]
        # A singular stiffness is a limit point of the branch: the caller tries a smaller load step.
        try:
            change = np.linalg.solve(
                stiffness, imbalance_Nm(chain, angles, force_N, weight_share)[1:]
            )
        except np.linalg.LinAlgError:
            return None
        angles[1:] -= change
        # Written so that NaN counts as too far.
        if not np.abs(angles - phi).max() < FARTHEST_TURN_RAD:
            return None
        if np.abs(change).max(initial=0.0) < CONVERGED_RAD:
            return angles
    return None


@dataclass(frozen=True)
class TipForceEstimate:
    """Estimate of the tip force with its uncertainty: `force_N` (2,) along and down.

    `singular_values` (2,) of the matrix that was inverted, largest first, and their ratio;
    `standard_errors_N` (2,) and `covariance_N2` (2, 2) that follow from the noise of the angles to
    first order; `residual_Nm` (n - 1,) of the hinge moments.
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


def tip_force_weighing_angles(
    chain: TipChain, phi: Floats, angle_noise_rad: float
) -> TipForceEstimate:
    """As `tip_force` with joint angles `phi` (n,), each moment weighted by its error: the estimate
    of least variance.

    Errors of the hinge moments are K_t times errors of the angles, K_t the tangent stiffness under
    load. Multiplied by its inverse, (10) yields the force whose shape is nearest to the photograph.
    K_t contains the force, so the estimate is iterated.
    """
    estimate = tip_force(chain, phi, angle_noise_rad)
    for _ in range(REFINEMENTS):
        before = estimate.force_N
        weights = np.asarray(
            np.linalg.inv(tangent_stiffness(chain, phi, before)[1:, 1:]), dtype=np.float64
        )
        estimate = _estimate(chain, phi, angle_noise_rad, weights)
        if np.abs(estimate.force_N - before).max() < REFINED_N:
            break
    return estimate


def _estimate(
    chain: TipChain, phi: Floats, angle_noise_rad: float, weights: Floats
) -> TipForceEstimate:
    B = tip_jacobian(chain, phi)[:, 1:].T
    moments = (chain.springs.torque_Nm(phi) - weight_torques_Nm(chain, phi))[1:]
    # Two singular values are needed for two components; a ratio of 1e-9 is rounding.
    U, s, Vt = np.linalg.svd(weights @ B, full_matrices=False)
    if len(s) < 2 or s[1] < 1e-9 * s[0]:
        raise BadInput(
            f"{len(moments)} hinge angles do not determine the two parts of the tip "
            "force; at least two hinges must bend apart"
        )
    pseudo_inverse = Vt.T / s @ U.T @ weights
    force = pseudo_inverse @ moments
    # An angle error dphi changes the moments by K_t dphi, and the pseudo-inverse turns those into a
    # change of the force.
    spread = pseudo_inverse @ tangent_stiffness(chain, phi, force)[1:, 1:] * angle_noise_rad
    return TipForceEstimate(force, s, float(s[0] / s[1]), spread @ spread.T, moments - B @ force)
