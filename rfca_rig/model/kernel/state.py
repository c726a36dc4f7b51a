"""Named tuples of arrays that the compiled code works on, and the symbols that all its modules use.

Symbols, as in the paper's section III with absolute angles instead of relative ones:
    n        number of links; c number of coordinates: n, or n + 1 where a frame yields
    q_i      absolute angle of link i, from +y, positive downwards [rad]; q_0 is the shaft
    w_i, a_i its speed [rad/s] and acceleration [rad/s2]
    Y_k, D_k place of the distal end of link k: along the ground, and depth below the shaft [m]
    delta_k  = D_k + r - H, how deep the circle of radius r around that end is in the ground [m]
    s_k      = Y_k - l q_k, displacement along the ground of the point where friction acts, rolling
             taken off: the circle's lowest one where the `lever` l of friction is r [m]; its force
             turns the link on l - rise delta
             (Y, D, delta and s are taken along and across the floor where it slopes)
    R        = M(q) a + h(q, w) - Q, the residual of the equations of motion [N m]; R_0 is the
             shaft torque
    J        = ca dR/da + cw dR/dw + cq dR/dq, the Jacobian of a stage, with the three weights the
             caller needs
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]


class Chain(NamedTuple):
    """Leg and ground as numbers. Arrays (n,) per link, `moment` (n, n) couples the links (inertia
    on its diagonal); SI units.

    `spring_origin` (n, p) and `spring_cubic` (n, p, 5) hold the measured curves of the hinges, p =
    0 where these follow k0 and k2; see `hinge_springs`.

    `gravity` pulls down and `gravity_along` towards +y. The floor falls away towards +y by an angle
    whose cosine and sine are given. A frame that yields has `frame_mass` > 0. Its displacement
    along a line, on a spring with damping, is the coordinate behind the last link. `frame_down` and
    `frame_aside` are cosine and sine of the line's lean from down towards y. The share
    `frame_on_sensor` of its mass stands between sensor and shaft: the sensor feels its inertia.
    `shaft_friction` acts against the rotation of the shaft. The floor has a bump of `bump_height`,
    at `bump_at` along it; see `bump`.
    """

    length: Floats
    first_moment: Floats
    k0: Floats
    k2: Floats
    spring_origin: Floats
    spring_cubic: Floats
    hinge_damping: Floats
    rest: Floats
    moment: Floats
    radius: float
    lever: float
    lever_rise: float
    gravity: float
    gravity_along: float
    total_mass: float
    ground_depth: float
    floor_cos: float
    floor_sin: float
    contact_stiffness: float
    contact_damping: float
    leaving_damping: float
    mu: float
    presliding: float
    drag: float
    frame_mass: float
    frame_stiffness: float
    frame_damping: float
    frame_on_sensor: float
    frame_down: float
    frame_aside: float
    shaft_friction: float
    bump_height: float
    bump_at: float
    bump_width: float


Weights = tuple[float, float, float]  # ca, cw, cq


class State(NamedTuple):
    """State of the chain, changed in place: `q`, `w`, `a` (c,) for every coordinate; `anchor` (n,)
    is the point on the ground to which each end's lowest point is tied [m]; `memory` (m, n, 4)
    holds the internal variables of m laws at each hinge or link.
    """

    q: Floats
    w: Floats
    a: Floats
    anchor: Floats
    memory: Floats


class Laws(NamedTuple):
    """Laws that effects add, as compiled functions at `address` (m,), called at their `place` (m,);
    see `laws`.

    `advance` (m,) is the address of the function that updates the memory after a step, 0 for none.
    `only` (m,) is the one hinge or link a law acts on, -1 for all; `parameter` (m, 8) or wider,
    where a table stands behind the eight numbers.
    """

    address: Integers
    advance: Integers
    place: Integers
    only: Integers
    parameter: Floats


NO_LAWS = Laws(
    np.empty(0, np.int64),
    np.empty(0, np.int64),
    np.empty(0, np.int64),
    np.empty(0, np.int64),
    np.empty((0, 8)),
)


class Shaft(NamedTuple):
    """What turns the shaft: a prescribed piecewise cubic angle, or (`free`) a rotor under feed +
    k_angle (angle - q) + k_speed (speed - w), where angle and speed follow the piecewise cubic if
    there is one.

    The part with k_angle engages only beyond `gap` on either side, there with the factor 1 + `loss`
    (speed - w). The torque stays within `limit`. Cogging is added: cogging sin(cycles (q - angle at
    the start) + phase). `breaks` (m + 1,) and `coefficient` (m, 4) are those of
    `motion.ShaftMotion`; `landings` (l,) are times on which a step must end.
    """

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
    gap: float = 0.0
    loss: float = 0.0
    limit: float = np.inf
    cogging: float = 0.0
    cycles: float = 0.0
    phase: float = 0.0


class Samples(NamedTuple):
    """Output samples at `t` (m,): `q`, `w` (m, c), `force` (m, 3) = fy, fz, shaft torque,
    `contact` (m, 2, n) = N, F.
    """

    t: Floats
    q: Floats
    w: Floats
    force: Floats
    contact: Floats


class Work(NamedTuple):
    """Working memory of one integration, allocated once so that no step allocates.

    Arrays without a shape have one entry per coordinate (c,).

    - `R`, `J` (c, c): the residual, and its derivative. Once factored, `J` holds its triangular
      factors.
    - `sin`, `cos`: of the angles last assembled.
    - `down`, `along` (n,): how every end beyond link j moves across and along the floor per radian
      of q_j. `across`, `aside` are the same over a floor that slopes under one end.
    - `arm`: how the middle of a link moves across the link per unit of each coordinate.
    - `speed2`, `by_cos`, `by_sin`: factors of the inertial coupling of the links.
    - `q`, `w`, `a`: of the stage being solved. `stage_q`, `stage_w`, `stage_a` (4, c): of the
      step's stages. `base_q`, `base_w`: what a stage has before its own acceleration adds to it.
      `jerk`: estimate of da/dt from the last step.
    - `contact` (2, n): N and F of each end. `force` (3,): fy, fz, shaft torque. `outside` (2,):
      force of the surroundings on the leg, along y and down.
    - `place` (n, 7): of each end its depth, depth rate, stretch, slip and three columns for `bump`.
      `ends` (n, 7): `place` where the step begins.
    - `limit` (3, n): friction limit mu |N| of the ends, as last evaluated, at the end of the step,
      and where it begins. An infinite one at the beginning means that the force of a tie follows
      from its stretch alone.
    - `regime` (2, n): on which branch the law of each contact is, and the slope of the effects in
      each hinge. `regime_of_J` (2, n): the same where J was made.
    - `x`, `out` (8,): arguments and results of the laws of effects.
    """

    R: Floats
    J: Floats
    sin: Floats
    cos: Floats
    down: Floats
    along: Floats
    across: Floats
    aside: Floats
    arm: Floats
    speed2: Floats
    by_cos: Floats
    by_sin: Floats
    q: Floats
    w: Floats
    a: Floats
    stage_q: Floats
    stage_w: Floats
    stage_a: Floats
    jerk: Floats
    base_q: Floats
    base_w: Floats
    contact: Floats
    force: Floats
    place: Floats
    ends: Floats
    limit: Floats
    regime: Floats
    regime_of_J: Floats
    outside: Floats
    x: Floats
    out: Floats
