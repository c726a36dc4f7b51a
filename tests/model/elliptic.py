"""The cantilever under a tip force in closed form, by elliptic integrals, as a reference for the
discrete elastica.

EI theta'' = F sin(theta - alpha) with theta(0) = 0 and theta'(L) = 0 is a pendulum. With chi = pi -
(alpha - theta), k = cos((alpha - theta_L) / 2) and sin(chi / 2) = k sin(phi), its first integral
gives ds = sqrt(EI / F) dphi / sqrt(1 - k^2 sin^2 phi), phi from phi_0 at the clamp, sin(phi_0) =
cos(alpha / 2) / k, to pi / 2 at the tip. Holds for 0 < theta_L < alpha < pi.
"""

import numpy as np
from scipy.special import ellipe, ellipeinc, ellipk, ellipkinc


def tip_of(EI, length_m, alpha_rad, slope_rad):
    """(force, x, y): the force in the direction alpha that turns the tip by slope, and where the
    tip is then.
    """
    k = np.cos(0.5 * (alpha_rad - slope_rad))
    phi_0 = np.arcsin(np.cos(0.5 * alpha_rad) / k)
    m = k * k
    first = ellipk(m) - ellipkinc(phi_0, m)
    second = ellipe(m) - ellipeinc(phi_0, m)
    force = EI * (first / length_m) ** 2
    unit = length_m / first
    against = unit * (2.0 * second - first)
    beside = unit * 2.0 * k * np.cos(phi_0)
    cos = np.cos(alpha_rad)
    sin = np.sin(alpha_rad)
    return force, -against * cos + beside * sin, -against * sin - beside * cos
