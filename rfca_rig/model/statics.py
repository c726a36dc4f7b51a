"""Kinematics and equilibrium of the chain under a force at its tip: section III.B, eqs. (9)-(10).

Symbols of the paper: phi_i angle of joint i (phi_1 the shaft, phi_2.. the hinges), varphi_k = phi_1 + .. + phi_k absolute angle of
link k, L_i its length; x along the ground and y downwards, so that angles count from x towards y. Positions and forces are
pairs (along, down). Two things are mended: the matrix printed in (10) is the transpose of J of (9), 7 x 2, or the product with
(F_x, F_y) has no sense; and its alpha_i is the varphi_i of (9). Joint 1 has no spring: there k_1 phi_1 stands for the torque of the drive.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rfca_rig.errors import SimulationFailed
from rfca_rig.model.hinge_springs import HingeSprings, springs_of
from rfca_rig.model.parameters import GRAVITY_M_S2, Leg

Floats = NDArray[np.float64]

NEWTON_LIMIT = 15
CONVERGED_RAD = 1e-12
FARTHEST_TURN_RAD = 0.3  # of a hinge within one load step, so that Newton stays on the branch that loading leads along
SMALLEST_LOAD_STEP = 1e-5


@dataclass(frozen=True)
class TipChain:
    """What the statics need of a leg: `L` (n,) [m], `mass` (n,) [kg], springs, and the radius of the tip's circle [m].

    The force acts at the lowest point of that circle, as it does on the ground; the paper has radius 0.
    """

    L: Floats
    mass: Floats
    springs: HingeSprings
    tip_radius_m: float = 0.0
    gravity_m_s2: float = GRAVITY_M_S2

    @property
    def first_moment(self) -> Floats:
        """Mass times arm that each link carries, its own half and all beyond it (n,) [kg m]."""
        beyond = np.cumsum(self.mass[::-1])[::-1] - self.mass
        return np.asarray(self.L * (0.5 * self.mass + beyond))


@dataclass(frozen=True)
class TipEquilibrium:
    """`phi` (n,) joint angles [rad]; the torque that holds the shaft; whether the hinges would return to it when pushed."""

    phi: Floats
    shaft_torque_Nm: float
    stable: bool


def tip_chain_of(leg: Leg) -> TipChain:
    """The leg of a rig, whose tip is the end circle of its last link."""
    return TipChain(np.array(leg.link_lengths_m), np.array(leg.link_masses_kg), springs_of(leg), leg.link_radius_m)


def absolute_angles(phi: Floats) -> Floats:
    """varphi_k, first line of (9)."""
    return np.asarray(np.cumsum(phi))


def tip_place_m(chain: TipChain, phi: Floats) -> Floats:
    """(x, y) of the tip, eq. (9)."""
    varphi = absolute_angles(phi)
    return np.array([chain.L @ np.cos(varphi), chain.L @ np.sin(varphi)])


def tip_jacobian(chain: TipChain, phi: Floats) -> Floats:
    """J (2, n) of eq. (9): how fast the point where the force acts moves along and down per unit speed of each joint [m/rad].

    The circle's lowest point rolls back by its radius with every joint that turns the last link.
    """
    varphi = absolute_angles(phi)
    along, down = from_link_on(-chain.L * np.sin(varphi)), from_link_on(chain.L * np.cos(varphi))
    return np.array([along - chain.tip_radius_m, down])


def from_link_on(per_link: Floats) -> Floats:
    """Sums over links i = n.. to the tip, as in (10): what a joint carries of quantities given per link."""
    return np.asarray(np.cumsum(per_link[::-1])[::-1])


def weight_torques_Nm(chain: TipChain, phi: Floats) -> Floats:
    """What the weight of the links beyond does to each joint (n,)."""
    return from_link_on(chain.gravity_m_s2 * chain.first_moment * np.cos(absolute_angles(phi)))


def imbalance_Nm(chain: TipChain, phi: Floats, force_N: Floats, weight_share: float = 1.0) -> Floats:
    """Springs less weight less J^T F (n,), zero in (10) at every hinge; at joint 1 it is the torque that holds the shaft.

    `force_N` (2,) = (along, down) on the tip, so a ground that pushes up is negative in its second place.
    """
    load = weight_share * weight_torques_Nm(chain, phi) + tip_jacobian(chain, phi).T @ force_N
    return np.asarray(chain.springs.torque_Nm(phi) - load)


def tangent_stiffness(chain: TipChain, phi: Floats, force_N: Floats, weight_share: float = 1.0) -> Floats:
    """Derivative (n, n) of the imbalance: K_i on the diagonal, and the geometric stiffness of the loads."""
    varphi = absolute_angles(phi)
    weight = -weight_share * chain.gravity_m_s2 * chain.first_moment * np.sin(varphi)
    tip = -chain.L * (force_N[0] * np.cos(varphi) + force_N[1] * np.sin(varphi))
    joints = np.arange(phi.size)
    geometric = from_link_on(weight + tip)[np.maximum(joints[:, None], joints[None, :])]
    return np.asarray(np.diag(chain.springs.stiffness_Nm_per_rad(phi)) - geometric)


def equilibrium_under_tip_force(chain: TipChain, shaft_angle_rad: float, force_N: Floats) -> TipEquilibrium:
    """The shape with the shaft held and a given force (along, down) on the tip, weight included.

    Weight and force grow together from the straight chain, in steps that are halved where Newton does not follow. Raises
    SimulationFailed where no equilibrium continues the branch, with the share of the load it carried.
    """
    phi = np.zeros(chain.L.size)
    phi[0] = shaft_angle_rad
    carried, step = 0.0, 0.25
    while carried < 1.0:
        share = min(1.0, carried + step)
        loaded = _newton(chain, phi, share * force_N, share)
        if loaded is not None:
            phi, carried, step = loaded, share, 2.0 * step
        else:
            step *= 0.5
        if step < SMALLEST_LOAD_STEP:
            raise _no_equilibrium(shaft_angle_rad, force_N, carried)
    hinges = tangent_stiffness(chain, phi, force_N)[1:, 1:]
    return TipEquilibrium(phi, float(imbalance_Nm(chain, phi, force_N)[0]), bool(np.all(np.linalg.eigvalsh(hinges) > 0.0)))


def _newton(chain: TipChain, phi: Floats, force_N: Floats, weight_share: float) -> Floats | None:
    at = phi.copy()
    for _ in range(NEWTON_LIMIT):
        stiffness = tangent_stiffness(chain, at, force_N, weight_share)[1:, 1:]
        try:
            change = np.linalg.solve(stiffness, imbalance_Nm(chain, at, force_N, weight_share)[1:])
        except np.linalg.LinAlgError:
            return None
        at[1:] -= change
        if not np.abs(at - phi).max() < FARTHEST_TURN_RAD:
            return None
        if np.abs(change).max(initial=0.0) < CONVERGED_RAD:
            return at
    return None


def _no_equilibrium(shaft_angle_rad: float, force_N: Floats, carried: float) -> SimulationFailed:
    return SimulationFailed(
        f"no equilibrium found beyond {100.0 * carried:.1f} % of weight and tip force ({force_N[0]:.1f} N along, {force_N[1]:.1f} N down), "
        f"shaft at {np.degrees(shaft_angle_rad):.1f} degrees; use a smaller force, or look for a slipped decimal point in the leg"
    )
