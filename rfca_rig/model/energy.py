"""Mechanical energy of the chain, which a stroke stores and returns. Symbols as in `state`."""

import numpy as np
from numpy.typing import NDArray

from rfca_rig.model.bump import fill_distances
from rfca_rig.model.state import Chain
from rfca_rig.model.torque_spline import SplineTable

Floats = NDArray[np.float64]


def mechanical_energy_J(chain: Chain, q_rad: Floats, w_rad_s: Floats) -> Floats:
    """Energy of motion, weight, springs and compressed floor, (m,) [J], for angles and speeds (m, n).

    Energy that effects store (a yielding frame, a second spring) is not included, nor that of stretched sticking contacts, a few mJ.
    """
    return kinetic_J(chain, q_rad, w_rad_s) + height_J(chain, q_rad) + springs_J(chain, q_rad) + floor_J(chain, q_rad)


def kinetic_J(chain: Chain, q_rad: Floats, w_rad_s: Floats) -> Floats:
    """Kinetic energy (m,) of angles and speeds (m, n): w M(q) w / 2 with M_ij = c_ij cos(q_i - q_j), as in `forces`."""
    # cos(q_i - q_j) = cos cos + sin sin, so no (m, n, n) array of differences is needed.
    cos, sin = w_rad_s * np.cos(q_rad), w_rad_s * np.sin(q_rad)
    return np.asarray(0.5 * (np.einsum("mi,ij,mj->m", cos, chain.moment, cos) + np.einsum("mi,ij,mj->m", sin, chain.moment, sin)))


def height_J(chain: Chain, q_rad: Floats) -> Floats:
    """Potential energy (m,) of the weight for angles (m, n): zero with all links level."""
    return np.asarray(-(chain.gravity * np.sin(q_rad) + chain.gravity_along * np.cos(q_rad)) @ chain.first_moment)


def springs_J(chain: Chain, q_rad: Floats) -> Floats:
    """Energy (m,) of the hinge springs for angles (m, n): k0 phi^2 / 2 + k0 k2 phi^4 / 4 each, or the integral of the spline."""
    phi = np.diff(q_rad, axis=1) - chain.rest[1:]
    if chain.spring_origin.size:
        return np.asarray(SplineTable(chain.spring_origin[1:], chain.spring_cubic[1:]).energy(phi) @ chain.k0[1:])
    phi2 = phi**2
    return np.asarray((phi2 * (0.5 + 0.25 * chain.k2[1:] * phi2)) @ chain.k0[1:])


def floor_J(chain: Chain, q_rad: Floats) -> Floats:
    """Energy (m,) of the compressed floor for angles (m, n): 2/5 stiffness depth^2.5 under every link end, on a bump where there is one."""
    sin, cos = np.sin(q_rad), np.cos(q_rad)
    up = chain.ground_depth * chain.floor_cos - np.cumsum(chain.length * (sin * chain.floor_cos - cos * chain.floor_sin), axis=1)
    if chain.bump_height != 0.0:
        y = np.cumsum(chain.length * (cos * chain.floor_cos + sin * chain.floor_sin), axis=1)
        fill_distances(chain, y, up.copy(), up)
    depth = chain.radius - up
    return np.asarray(0.4 * chain.contact_stiffness * (np.maximum(depth, 0.0) ** 2.5).sum(axis=1))
