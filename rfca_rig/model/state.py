"""What the compiled code works on, as named tuples, and the symbols of all of it.

Symbols, as in the paper's section III with absolute angles instead of relative ones:
    q_i      absolute angle of link i, from +y, positive downwards [rad]; q_0 is the shaft
    w_i, a_i its speed [rad/s] and acceleration [rad/s2]
    Y_k, D_k place of the distal end of link k: along the ground, and depth below the shaft [m]
    delta_k  = D_k + r - H, how deep the circle of radius r around that end is in the ground [m]
    s_k      = Y_k - l q_k, displacement along the ground of the point where friction acts, rolling taken off: the circle's lowest
             one where the `lever` l of friction is r [m]; its force turns the link on l - rise delta
               (Y, D, delta and s are taken along and across the floor where it slopes)
    R        = M(q) a + h(q, w) - Q, the residual of the equations of motion [N m]; R_0 is the shaft torque
    J        = ca dR/da + cw dR/dw + cq dR/dq, with the three weights the caller needs
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]


class Chain(NamedTuple):
    """Leg and ground. Arrays (n,) per link, `moment` (n, n) couples the links (inertia on its diagonal); SI units.

    `spring_origin` (n, p) and `spring_cubic` (n, p, 5) hold the measured curves of the hinges, p = 0 where these follow k0 and k2; see
    `torque_spline`.

    `gravity` pulls down and `gravity_along` towards +y. The floor falls away towards +y by an angle whose cosine and sine are
    given. A frame that yields has `frame_mass` > 0 and is the coordinate behind the last link: its way along a line, on a
    spring with damping. `frame_down` and `frame_aside` are cosine and sine of the line's lean from down towards y. The share
    `frame_on_sensor` of its mass stands between sensor and shaft: the sensor feels its inertia.
    `shaft_friction` drags against the turn of the shaft. The floor has a bump of `bump_height`, at `bump_at` along it; see `bump`.
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
    """Where the chain is, changed in place: q, w, a for every coordinate; per link the `anchor` to which the end's lowest point
    is tied on the ground [m]; `memory` (m, n, 4) is what the laws of effects remember of each hinge or link.
    """

    q: Floats
    w: Floats
    a: Floats
    anchor: Floats
    memory: Floats


class Laws(NamedTuple):
    """Laws that effects add, as compiled functions at `address` (m,), called at their `place`; see `laws`.

    `only` (m,) is the one hinge or link a law acts on, -1 for all; `parameter` (m, 8).
    """

    address: Integers
    advance: Integers
    place: Integers
    only: Integers
    parameter: Floats


class Shaft(NamedTuple):
    """What turns the shaft: a prescribed piecewise cubic angle, or (`free`) a rotor under
    feed + k_angle (angle - q) + k_speed (speed - w), where angle and speed follow the piecewise cubic if there is one. The part with
    k_angle engages only beyond `gap` on either side, there with the factor 1 + `loss` (speed - w). The torque stays within `limit`.
    Beside it acts cogging sin(cycles (q - angle at the start) + phase).
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
    """Room for samples at `t` (m,): `q`, `w` (m, coordinates), `force` (m, 3) = fy, fz, shaft torque, `contact` (m, 2, n) = N, F."""

    t: Floats
    q: Floats
    w: Floats
    force: Floats
    contact: Floats


class Work(NamedTuple):
    """Scratch of one integration.

    `J` holds its triangular factors with the row exchanges `pivot` once it is factored. `sin`, `cos` are those of the angles last
    assembled; `down`, `along` (n,) how every end beyond link j moves across and along
    the floor per radian of q_j; `arm` how the middle of a link moves across it per unit of each coordinate; `speed2`, `by_cos`,
    `by_sin` what the coupling of links needs of each; `place` (n, 7) of each end its depth, sinking, stretch and slip, and what
    `bump` needs; `across`, `aside` (coordinates) are `down` and `along` over the floor that slopes under one end; `regime` (2, n) on
    which branch the law of each contact is, and the slope of the effects in each hinge, `regime_of_J` those at which J was
    made; `outside` (2,) the force of the surroundings on the leg along y and down; `x` and `out` (8,) go to and from the laws of
    effects. `q`, `w`, `a` are those of the stage in work, `stage_w` and `stage_a` (4, coordinates) those of the step's stages;
    `jerk` is what the last step says of the acceleration's change, and `ends` (n, 7) is `place` where the step
    begins. `limit` (3, n) is the friction limit mu |N| of the ends: as last evaluated, at the end of the step, and
    where it begins. An infinite one at the beginning says that the stretch alone tells what a tie carries.
    """

    R: Floats
    J: Floats
    pivot: Integers
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
