"""What the compiled code works on, as named tuples, and the symbols of all of it.

Symbols, as in the paper's section III with absolute angles instead of relative ones:
    q_i      absolute angle of link i, from +y, positive downwards [rad]; q_0 is the shaft
    w_i, a_i its speed [rad/s] and acceleration [rad/s2]
    Y_k, D_k place of the distal end of link k: along the ground, and depth below the shaft [m]
    delta_k  = D_k + r - H, how deep the circle of radius r around that end is in the ground [m]
    s_k      = Y_k - r q_k, displacement of the circle's lowest point along the ground, rolling taken off [m]
    R        = M(q) a + h(q, w) - Q, the residual of the equations of motion [N m]; R_0 is the shaft torque
    J        = ca dR/da + cw dR/dw + cq dR/dq, with the three weights the caller needs
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]


class Chain(NamedTuple):
    """Leg and ground. Arrays (n,) per link, `moment` (n, n) couples the links (inertia on its diagonal); SI units."""

    length: Floats
    first_moment: Floats
    k0: Floats
    k2: Floats
    hinge_damping: Floats
    moment: Floats
    radius: float
    gravity: float
    total_mass: float
    ground_depth: float
    contact_stiffness: float
    contact_damping: float
    mu: float
    grip: float
    drag: float


class State(NamedTuple):
    """Where the chain is, all (n,), changed in place. `anchor` is where each end's lowest point is tied to the ground [m]."""

    q: Floats
    w: Floats
    a: Floats
    anchor: Floats


class Shaft(NamedTuple):
    """What turns the shaft: a prescribed piecewise cubic angle, or (`free`) a rotor under feed + k (angle - q) + kw (speed - w)."""

    breaks: Floats
    coefficient: Floats
    landings: Floats
    free: bool
    rotor: float
    feed: float
    k_angle: float
    angle: float
    k_speed: float
    speed: float


class Samples(NamedTuple):
    """Room for samples at `t` (m,): `q`, `w` (m, n), `force` (m, 3) = fy, fz, shaft torque, `contact` (m, 2, n) = N, F."""

    t: Floats
    q: Floats
    w: Floats
    force: Floats
    contact: Floats


class Work(NamedTuple):
    """Scratch of one integration; `sin`, `cos` are those of the angles last assembled."""

    R: Floats
    J: Floats
    sin: Floats
    cos: Floats
    q: Floats
    w: Floats
    a: Floats
    w_mid: Floats
    a_mid: Floats
    base_q: Floats
    base_w: Floats
    contact_old: Floats
    contact: Floats
    force_old: Floats
    force: Floats
