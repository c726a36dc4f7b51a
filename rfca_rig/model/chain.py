"""The leg as arrays for the compiled chain, and its rest pose."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rfca_rig.errors import SimulationFailed
from rfca_rig.model import kernel
from rfca_rig.model.parameters import GRAVITY_M_S2, Leg, RigModel

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Chain:
    """`scalar` as numbered in the kernel; `link` rows: length, first moment, k0, k2, hinge damping; `moment` (n, n)."""

    scalar: Floats
    link: Floats
    moment: Floats

    @property
    def links(self) -> int:
        return int(self.link.shape[1])


def chain_of(rig: RigModel, height_m: float) -> Chain:
    """The arrays of `rig` with its shaft `height_m` above the ground."""
    leg, ground = rig.leg, rig.ground
    lengths, masses = np.array(leg.link_lengths_m), np.array(leg.link_masses_kg)
    reach = _reach(lengths)
    moment = np.einsum("k,ki,kj->ij", masses, reach, reach) + np.diag(masses * lengths**2 / 12.0)
    scalar = [
        leg.link_radius_m,
        GRAVITY_M_S2,
        float(masses.sum()),
        height_m,
        ground.stiffness_N_per_m1p5,
        ground.damping_s_per_m,
        ground.friction_coefficient,
        ground.grip_N_per_m,
        ground.drag_N_s_per_m,
    ]
    return Chain(np.array(scalar), np.array([lengths, masses @ reach, *_hinges(leg)]), moment)


def _reach(lengths: Floats) -> Floats:
    """(n, n): how far the centre of link k moves along the normal of link i per radian of q_i."""
    return np.tril(np.broadcast_to(lengths, (lengths.size, lengths.size)), -1) + np.diag(lengths / 2.0)


def _hinges(leg: Leg) -> list[Floats]:
    count = len(leg.link_lengths_m)
    return [np.full(count, value) for value in (leg.k0_Nm_per_rad, leg.k2_per_rad2, leg.hinge_damping_Nm_s_per_rad)]


@dataclass
class ChainState:
    """Where the chain is: angles, speeds, accelerations and contact anchors (n,); `step_s` is the next step to try."""

    q: Floats
    w: Floats
    a: Floats
    anchor: Floats
    step_s: float = 1e-4


def at_rest(chain: Chain, shaft_angle_rad: float) -> ChainState:
    """The chain hanging under its weight with the shaft held; frictionless where an end touches."""
    q = np.full(chain.links, shaft_angle_rad)
    if not kernel.settle(chain.scalar, chain.link, chain.moment, q, 1e-12):
        raise SimulationFailed(f"no rest pose found with the shaft at {np.degrees(shaft_angle_rad):.1f} degrees; is the rack height right?")
    anchor = np.cumsum(chain.link[0] * np.cos(q)) - chain.scalar[kernel.RADIUS] * q
    return ChainState(q, np.zeros_like(q), np.zeros_like(q), anchor)
