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
FARTHEST_TURN_RAD = 0.3  # of a hinge within one load step
# Of a hinge after one load step from where the tangent of the branch leads. A leg that is nearly a
# straight column has a second stable branch, and a longer step may jump to it: at 0.3, 2 of 4056
# loads end with more energy than there, without this limit 4, at 0.1 and 0.03 none.
OFF_TANGENT_RAD = 0.05
SMALLEST_LOAD_STEP = 1e-5
# A leg whose branch ends is pushed by so much along its softest mode, to leave a saddle point.
SNAP_PUSH_RAD = 1e-3
DESCENT_LIMIT = 500
# A stiffness below this counts as none: that of a hinge is some ten N m/rad.
SOFTEST_NM_PER_RAD = 1e-9
# of an energy of some ten J
ROUNDING_J = 1e-12

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
    """`phi` (n,) joint angles [rad]; the torque that holds the shaft; the share of the load at
    which the leg snapped for the last time, None if it bends steadily.
    """

    phi: Floats
    shaft_torque_Nm: float
    snapped_at: float | None


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
    """Place (2,) of the tip, the middle of its circle, x along and y down [m], for joint angles
    `phi` (n,), eq. (9).
    """
    varphi = absolute_angles(phi)
    return np.array([chain.L @ np.cos(varphi), chain.L @ np.sin(varphi)])


def tip_jacobian(chain: TipChain, phi: Floats) -> Floats:
    """Jacobian J (2, n) of eq. (9) at joint angles `phi` (n,): derivative of `tip_place_m`, along
    and down [m/rad].
    """
    varphi = absolute_angles(phi)
    along = sum_to_tip(-chain.L * np.sin(varphi))
    down = sum_to_tip(chain.L * np.cos(varphi))
    return np.array([along, down])


def touching_point_jacobian(chain: TipChain, phi: Floats) -> Floats:
    """How the point of the leg that is the lowest of the tip's circle moves, along and down
    (2, n) [m/rad]: the Jacobian for the force of a floor.

    This point is `tip_radius_m` below the tip, and goes back by that much per radian of any joint.
    Without a radius it is the tip, as in (10).
    """
    jacobian = tip_jacobian(chain, phi)
    jacobian[0] -= chain.tip_radius_m
    return jacobian


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
    """Torques of the springs less those of weight and tip force, J^T F, where J is
    `touching_point_jacobian`.

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
    tip_torques = touching_point_jacobian(chain, phi).T @ force_N
    load = weight_share * weight_torques_Nm(chain, phi) + tip_torques
    return np.asarray(chain.springs.torque_Nm(phi) - load)


def potential_energy_J(
    chain: TipChain, phi: Floats, force_N: Floats, weight_share: float = 1.0
) -> float:
    """Energy of springs, weight and a dead force on the tip, 0 for a straight horizontal leg
    without force; its derivative by `phi` (n,) is `imbalance_Nm`, whose arguments it takes.
    """
    varphi = absolute_angles(phi)
    weight_J = weight_share * chain.gravity_m_s2 * float(chain.first_moment @ np.sin(varphi))
    place = tip_place_m(chain, phi)
    # The force acts on the lowest point of the circle, which rolls back as the last link turns.
    place[0] -= chain.tip_radius_m * varphi[-1]
    return float(chain.springs.energy_J(phi).sum()) - weight_J - float(force_N @ place)


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
    """Stable shape of the leg with the shaft held and a given force on the tip, weight included.

    Weight and force grow together from the leg at rest, in steps that are halved where Newton does
    not find a stable equilibrium nearby. Where the branch of stable equilibria ends, as that of a
    column at its critical load, the leg snaps: its energy falls to a minimum under the same load,
    and the load grows on from there.

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
        The one that a slowly growing load leads to. Another load history may lead to another.

    Raises
    ------
    SimulationFailed
        Where there is no stable equilibrium; it names the share of the load that was reached.

    References
    ----------
    Equations (9) and (10).
    """
    phi = np.append(shaft_angle_rad, chain.springs.rest_rad[1:])
    carried = 0.0
    step = 0.25
    snapped_at = None
    while carried < 1.0:
        share = min(1.0, carried + step)
        loaded = _continue_branch(chain, phi, force_N, carried, share)
        if loaded is None and step < SMALLEST_LOAD_STEP:
            loaded = _snap(chain, phi, share * force_N, share)
            if loaded is None:
                raise SimulationFailed(
                    f"no equilibrium found beyond {100.0 * carried:.1f} % of weight and tip force "
                    f"({force_N[0]:.1f} N along, {force_N[1]:.1f} N down), "
                    f"shaft at {np.degrees(shaft_angle_rad):.1f} degrees; use a smaller "
                    "force, or look for a slipped decimal point in the leg"
                )
            snapped_at = share
        if loaded is not None:
            phi = loaded
            carried = share
            step = 2.0 * step
        else:
            step *= 0.5
    return TipEquilibrium(phi, float(imbalance_Nm(chain, phi, force_N)[0]), snapped_at)


def is_stable(chain: TipChain, phi: Floats, force_N: Floats, weight_share: float = 1.0) -> bool:
    """Whether an equilibrium at joint angles `phi` (n,) is a minimum of the energy with the shaft
    held: its second variation is positive. Arguments as in `imbalance_Nm`.
    """
    hinges = tangent_stiffness(chain, phi, force_N, weight_share)[1:, 1:]
    return bool(np.all(np.linalg.eigvalsh(hinges) > 0.0))


def _continue_branch(
    chain: TipChain, phi: Floats, force_N: Floats, carried: float, share: float
) -> Floats | None:
    """The stable equilibrium (n,) at this share of weight and force, from `phi` (n,) at the share
    that is `carried`; None where Newton finds none, or one of another branch.
    """
    loaded = _newton(chain, phi, share * force_N, share)
    if loaded is None:
        return None
    stiffness = tangent_stiffness(chain, phi, carried * force_N, carried)[1:, 1:]
    # At `phi`, springs and the old load are in balance: the load that is added is left over.
    added = imbalance_Nm(chain, phi, share * force_N, share)[1:]
    # Singular at the end of a branch, and for hinges without springs.
    try:
        on_tangent = phi[1:] - np.linalg.solve(stiffness, added)
    except np.linalg.LinAlgError:
        return None
    if np.abs(loaded[1:] - on_tangent).max(initial=0.0) > OFF_TANGENT_RAD:
        return None
    return loaded


def _snap(chain: TipChain, phi: Floats, force_N: Floats, weight_share: float) -> Floats | None:
    """The minimum of the energy to which the leg falls from `phi` (n,), an equilibrium under a
    slightly smaller load; None where there is none.
    """
    if not np.isfinite(chain.springs.stiffness_Nm_per_rad(phi)).all():
        return None
    stiffness = tangent_stiffness(chain, phi, force_N, weight_share)[1:, 1:]
    softest_mode = np.linalg.eigh(stiffness)[1][:, 0]
    # It may fall to either side; where both are possible, to the one with less energy.
    minima = []
    for side in (1.0, -1.0):
        pushed = phi.copy()
        pushed[1:] += side * SNAP_PUSH_RAD * softest_mode
        angles = _descend(chain, pushed, force_N, weight_share)
        if angles is not None:
            minima.append(angles)
    if not minima:
        return None
    return min(minima, key=lambda angles: potential_energy_J(chain, angles, force_N, weight_share))


def _descend(chain: TipChain, phi: Floats, force_N: Floats, weight_share: float) -> Floats | None:
    """The minimum of the energy downhill from joint angles `phi` (n,), by Newton's method with
    the magnitudes of the curvatures, so that each step goes down (Nocedal and Wright, Numerical
    Optimization, section 3.4); None if it does not converge.
    """
    angles = phi.copy()
    energy = potential_energy_J(chain, angles, force_N, weight_share)
    for _ in range(DESCENT_LIMIT):
        stiffness = tangent_stiffness(chain, angles, force_N, weight_share)[1:, 1:]
        values, vectors = np.linalg.eigh(stiffness)
        slope = vectors.T @ imbalance_Nm(chain, angles, force_N, weight_share)[1:]
        change = -vectors @ (slope / np.maximum(np.abs(values), SOFTEST_NM_PER_RAD))
        largest = float(np.abs(change).max(initial=0.0))
        if largest < CONVERGED_RAD:
            if not is_stable(chain, angles, force_N, weight_share):
                return None
            return angles
        change *= min(1.0, FARTHEST_TURN_RAD / largest)
        while True:
            moved = angles.copy()
            moved[1:] += change
            lower = potential_energy_J(chain, moved, force_N, weight_share)
            # Near the minimum, the energy falls by less than its rounding.
            if lower <= energy + ROUNDING_J:
                break
            change *= 0.5
            if np.abs(change).max(initial=0.0) < CONVERGED_RAD:
                return None
        angles = moved
        energy = lower
    return None


def _newton(chain: TipChain, phi: Floats, force_N: Floats, weight_share: float) -> Floats | None:
    """The stable equilibrium near joint angles `phi` (n,); None where Newton finds none."""
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
            if not is_stable(chain, angles, force_N, weight_share):
                return None
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
    B = touching_point_jacobian(chain, phi)[:, 1:].T
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
