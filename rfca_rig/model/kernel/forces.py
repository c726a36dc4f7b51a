"""Equations of motion of the chain: residual R, its Jacobian J, the reaction at the mount, and
the energy. Symbols as in `state`.
"""

import numpy as np

from rfca_rig.model.hinge_springs import SplineTable, spring
from rfca_rig.model.kernel.bump import fill_distances, find_slope_direction
from rfca_rig.model.kernel.compiled import jit, jit_inline, jit_internal
from rfca_rig.model.kernel.contact import add_contacts, locate_ends
from rfca_rig.model.kernel.lanes import in_all_lanes, in_any_lane, select
from rfca_rig.model.kernel.laws import HINGE, LINK, ROTOR, call_law
from rfca_rig.model.kernel.state import Chain, Floats, Laws, State, Weights, Work

# speed at which friction of the shaft is full: no reading resolves a slower turn
DRAGGED_FROM_RAD_S = 0.02
TWO_OVER_PI = 2.0 / np.pi
# pi / 2 in two parts (Cody and Waite): the first has 33 bits, so that its product with a small
# integer is exact.
RIGHT_ANGLE_HIGH = 1.5707963267341256
RIGHT_ANGLE_LOW = 6.077100506506192e-11
# Coefficients of fdlibm's __kernel_sin and __kernel_cos.
S1 = -1.66666666666666324348e-01
S2 = 8.33333333332248946124e-03
S3 = -1.98412698298579493134e-04
S4 = 2.75573137070700676789e-06
S5 = -2.50507602534068634195e-08
S6 = 1.58969099521155010221e-10
C1 = 4.16666666666666019037e-02
C2 = -1.38888888888741095749e-03
C3 = 2.48015872894767294178e-05
C4 = -2.75573143513906633035e-07
C5 = 2.08757232129817482790e-09
C6 = -1.13596475577881948265e-11


@jit_inline
def sine_and_cosine(angle: float) -> tuple[float, float]:
    """Sine and cosine, exact but for the last bit, for angles up to some thousand turns, in half
    the time of two calls.

    The nearest multiple of a right angle is subtracted in two parts; fdlibm's polynomials
    approximate both on the rest.
    """
    quarters = np.floor(angle * TWO_OVER_PI + 0.5)
    r = (angle - quarters * RIGHT_ANGLE_HIGH) - quarters * RIGHT_ANGLE_LOW
    z = r * r
    sin = S4 + z * (S5 + z * S6)
    sin = r + r * z * (S1 + z * (S2 + z * (S3 + z * sin)))
    cos = C4 + z * (C5 + z * C6)
    cos = 1.0 - 0.5 * z + z * z * (C1 + z * (C2 + z * (C3 + z * cos)))
    if not in_all_lanes(quarters == 0.0):
        quadrant = quarters - 4.0 * np.floor(0.25 * quarters)
        odd = (quadrant == 1.0) | (quadrant == 3.0)
        sin, cos = select(odd, cos, sin), select(odd, sin, cos)
        sin = select(quadrant > 1.5, -sin, sin)
        cos = select((quadrant == 1.0) | (quadrant == 2.0), -cos, cos)
    return sin, cos


@jit_inline
def add_inertia(chain: Chain, w: Floats, a: Floats, weights: Weights | None, work: Work) -> None:
    """Writes M a + h into R: M_ij = c_ij cos(q_i - q_j), h_i = sum_j c_ij sin(q_i - q_j) w_j^2,
    with the (n, n) moments c_ij.

    `w` and `a` are (c,). Called first: it overwrites R and J, and all others add to them.
    """
    R = work.R
    J = work.J
    sin = work.sin
    cos = work.cos
    moment = chain.moment
    speed2 = work.speed2
    by_cos = work.by_cos
    by_sin = work.by_sin
    for i in range(w.size):
        speed2[i] = w[i] * w[i]
        R[i] = 0.0
        if weights is not None:
            by_cos[i] = weights[0] - weights[2] * speed2[i]
            by_sin[i] = 2.0 * weights[1] * w[i] + weights[2] * a[i]
    for i in range(moment.shape[0]):
        # Each pair of links is visited once: sine and cosine of q_i - q_j serve both rows.
        row = moment[i, i] * a[i]
        by_own_angle = 0.0
        for j in range(i):
            c = moment[i, j] * (cos[i] * cos[j] + sin[i] * sin[j])
            s = moment[i, j] * (sin[i] * cos[j] - cos[i] * sin[j])
            row += c * a[j] + s * speed2[j]
            R[j] += c * a[i] - s * speed2[i]
            if weights is not None:
                J[i, j] = c * by_cos[j] + s * by_sin[j]
                J[j, i] = c * by_cos[i] - s * by_sin[i]
                by_own_angle += c * speed2[j] - s * a[j]
                J[j, j] += weights[2] * (c * speed2[i] + s * a[i])
        R[i] = row
        if weights is not None:
            J[i, i] = weights[0] * moment[i, i] + weights[2] * by_own_angle
    if weights is not None:
        # The coordinate of a frame has no moment with the links; `add_frame` adds to these entries.
        for i in range(moment.shape[0], w.size):
            for j in range(w.size):
                J[i, j] = J[j, i] = 0.0


@jit_inline
def add_shaft_friction(chain: Chain, w: Floats, weights: Weights | None, work: Work) -> None:
    """Adds friction at the shaft from outside the leg; the motor overcomes it, so it shows in
    the shaft torque. `w` is (c,).
    """
    if in_any_lane(chain.shaft_friction != 0.0):
        # A sign function has no slope at rest, and Newton's iteration would not converge.
        share = np.tanh(w[0] / DRAGGED_FROM_RAD_S)
        work.R[0] += chain.shaft_friction * share
        if weights is not None:
            work.J[0, 0] += (
                weights[1] * chain.shaft_friction * (1.0 - share * share) / DRAGGED_FROM_RAD_S
            )


@jit_inline
def rotate_to_frame(chain: Chain, sin: float, cos: float) -> tuple[float, float]:
    """Sine and cosine of an angle plus the lean of the line along which the frame yields."""
    return (
        sin * chain.frame_down + cos * chain.frame_aside,
        cos * chain.frame_down - sin * chain.frame_aside,
    )


@jit_inline
def add_frame(
    chain: Chain, q: Floats, w: Floats, a: Floats, weights: Weights | None, work: Work
) -> None:
    """Adds a frame that yields by q_b on a spring, if there is one: coordinate b behind the last
    link, 0 where it carries the leg at rest.

    It yields along a line that leans from down towards y: for that, sines and cosines are those of
    q_i plus this angle. `q`, `w` and `a` are (c,).
    """
    R = work.R
    J = work.J
    b = chain.length.size
    if q.size == b:
        return
    mass = chain.frame_mass + chain.total_mass
    R[b] += mass * a[b] + chain.frame_damping * w[b] + chain.frame_stiffness * q[b]
    for i in range(b):
        S = chain.first_moment[i]
        (sin, cos) = rotate_to_frame(chain, work.sin[i], work.cos[i])
        # The leg's mass centre accelerates along the line by the links' rotation; in return the
        # frame's acceleration turns the links.
        R[b] += S * (cos * a[i] - sin * w[i] * w[i])
        R[i] += S * cos * a[b]
    if weights is None:
        return
    ca, cw, cq = weights
    J[b, b] += ca * mass + cw * chain.frame_damping + cq * chain.frame_stiffness
    for i in range(b):
        S = chain.first_moment[i]
        (sin, cos) = rotate_to_frame(chain, work.sin[i], work.cos[i])
        J[b, i] += (
            ca * S * cos - cw * 2.0 * S * sin * w[i] - cq * S * (sin * a[i] + cos * w[i] * w[i])
        )
        J[i, b] += ca * S * cos
        J[i, i] -= cq * S * sin * a[b]


@jit_inline
def add_weight_and_hinges(
    chain: Chain, q: Floats, w: Floats, weights: Weights | None, work: Work
) -> None:
    """Adds the weight of the links, and in each hinge its spring + c dphi/dt, phi from the rest
    angle; `q` and `w` are (c,).
    """
    R = work.R
    J = work.J
    for i in range(chain.length.size):
        weight = chain.gravity * chain.first_moment[i]
        aside = chain.gravity_along * chain.first_moment[i]
        R[i] -= weight * work.cos[i] - aside * work.sin[i]
        if weights is not None:
            J[i, i] += weights[2] * (weight * work.sin[i] + aside * work.cos[i])
    for i in range(1, chain.length.size):
        elastic, slope = spring(chain, i, q[i] - q[i - 1] - chain.rest[i])
        k0 = chain.k0[i]
        c = chain.hinge_damping[i]
        torque = elastic + c * (w[i] - w[i - 1])
        # Angles are absolute: a torque between links i - 1 and i acts on both, with opposite signs.
        R[i] += torque
        R[i - 1] -= torque
        if weights is not None:
            add_hinge_slope(i, weights[2] * k0 * slope + weights[1] * c, J)


@jit_inline
def add_hinge_slope(i: int, slope: float, J: Floats) -> None:
    """Adds the weighted derivative of a torque that resists q_i - q_(i-1) to J (c, c)."""
    J[i, i] += slope
    J[i - 1, i - 1] += slope
    J[i, i - 1] -= slope
    J[i - 1, i] -= slope


@jit_inline
def add_hinge_laws(
    chain: Chain,
    laws: Laws,
    state: State,
    elapsed: float,
    q: Floats,
    w: Floats,
    a: Floats,
    weights: Weights | None,
    work: Work,
) -> None:
    """Adds the torques of effects in the hinges; `elapsed` [s] counts from the beginning of the
    step, `q`, `w` and `a` are (c,).
    """
    # The slope of all effects is noted, because a large change of it makes J outdated; see
    # `stage.is_jacobian_valid`.
    for i in range(chain.length.size):
        work.regime[1, i] = 0.0
    for m in range(laws.place.size):
        if laws.place[m] == HINGE or laws.place[m] == ROTOR:
            for i in range(1, chain.length.size):
                if laws.only[m] in (-1, i):
                    call_hinge(chain, laws, laws.address[m], m, i, state, elapsed, q, w, a, work)
                    work.R[i] += work.out[0]
                    work.R[i - 1] -= work.out[0]
                    work.regime[1, i] += work.out[1]
                    if weights is not None:
                        add_hinge_slope(
                            i,
                            weights[2] * work.out[1]
                            + weights[1] * work.out[2]
                            + weights[0] * work.out[3],
                            work.J,
                        )


@jit_inline
def call_hinge(
    chain: Chain,
    laws: Laws,
    address: int,
    m: int,
    i: int,
    state: State,
    elapsed: float,
    q: Floats,
    w: Floats,
    a: Floats,
    work: Work,
) -> None:
    """Calls one of the two functions of hinge law m for hinge i; `q`, `w` and `a` are (c,), the
    result is in `work.out` (8,).
    """
    # All arguments that any hinge law takes, by their places; see the signatures in `laws`.
    work.x[0] = q[i] - q[i - 1] - chain.rest[i]
    work.x[1] = w[i] - w[i - 1]
    work.x[2] = elapsed
    work.x[3] = chain.k0[i]
    work.x[4] = chain.k2[i]
    work.x[5] = a[i] - a[i - 1]
    call_law(address, work.x, state.memory[m, i], laws.parameter[m], work.out)


@jit_inline
def add_link_laws(
    chain: Chain, laws: Laws, state: State, w: Floats, weights: Weights | None, work: Work
) -> None:
    """Adds forces of the surroundings across the links; J neglects how they depend on the pose.
    `w` is (c,).
    """
    for m in range(laws.place.size):
        if laws.place[m] == LINK:
            for i in range(chain.length.size):
                if laws.only[m] in (-1, i):
                    add_link_law(chain, laws, m, i, state, w, weights, work)


@jit_inline
def add_link_law(
    chain: Chain,
    laws: Laws,
    m: int,
    i: int,
    state: State,
    w: Floats,
    weights: Weights | None,
    work: Work,
) -> None:
    """Adds law m on link i, at its middle; `w` is (c,)."""
    # Projected on the normal of link i: an earlier link j moves it by L_j cos(q_i - q_j), a frame
    # by cos q_i, later links not at all.
    arm = work.arm
    v = 0.0
    for j in range(w.size):
        if j < i:
            arm[j] = chain.length[j] * (work.cos[i] * work.cos[j] + work.sin[i] * work.sin[j])
        elif j == i:
            arm[j] = 0.5 * chain.length[i]
        else:
            arm[j] = work.cos[i] if j >= chain.length.size else 0.0
        v += arm[j] * w[j]
    work.x[0] = v
    work.x[1] = chain.length[i]
    call_law(laws.address[m], work.x, state.memory[m, i], laws.parameter[m], work.out)
    F = work.out[0]
    F_v = work.out[1]
    work.outside[0] -= F * work.sin[i]
    work.outside[1] += F * work.cos[i]
    for j in range(w.size):
        work.R[j] -= F * arm[j]
        if weights is not None:
            for k in range(w.size):
                work.J[j, k] -= weights[1] * F_v * arm[j] * arm[k]


@jit_inline
def prepare_pose(chain: Chain, q: Floats, work: Work) -> None:
    """Writes sines, cosines and lever arms of the pose `q` (c,) into `work`, for all functions
    that need them.
    """
    sin = work.sin
    cos = work.cos
    down = work.down
    along = work.along
    work.outside[0] = work.outside[1] = 0.0
    for i in range(chain.length.size):
        sin[i], cos[i] = sine_and_cosine(q[i])
        down[i] = chain.length[i] * (cos[i] * chain.floor_cos + sin[i] * chain.floor_sin)
        along[i] = chain.length[i] * (cos[i] * chain.floor_sin - sin[i] * chain.floor_cos)


@jit_inline
def assemble(
    chain: Chain,
    laws: Laws,
    state: State,
    elapsed: float,
    q: Floats,
    w: Floats,
    a: Floats,
    weights: Weights | None,
    work: Work,
) -> None:
    """Writes the residual R (c,) and the forces of the ground `contact` (2, n) into `work`; with
    `weights`, J (c, c) too.

    `q`, `w`, `a` are (c,). `state` gives anchors and memory of laws from the beginning of the step,
    `elapsed` [s] ago. For `weights` None the compiler makes a version of its own. It makes none for
    a chain without laws: such a version is 3 % faster and takes as long to compile as all the rest.
    """
    prepare_pose(chain, q, work)
    add_inertia(chain, w, a, weights, work)
    add_weight_and_hinges(chain, q, w, weights, work)
    add_surroundings(chain, laws, state, elapsed, q, w, a, weights, work)


@jit_internal
def assemble_stiffness(
    chain: Chain,
    laws: Laws,
    state: State,
    elapsed: float,
    q: Floats,
    w: Floats,
    a: Floats,
    work: Work,
) -> None:
    """As `assemble` with J = dR/dq, for equilibria; `q`, `w` and `a` are (c,).

    It is called, not inlined, so that it is compiled once for several places where its speed does
    not matter.
    """
    assemble(chain, laws, state, elapsed, q, w, a, (0.0, 0.0, 1.0), work)


@jit_inline
def add_surroundings(
    chain: Chain,
    laws: Laws,
    state: State,
    elapsed: float,
    q: Floats,
    w: Floats,
    a: Floats,
    weights: Weights | None,
    work: Work,
) -> None:
    """Adds the ground and all effects; `q`, `w` and `a` are (c,)."""
    locate_ends(chain, state, q, w, work)
    add_shaft_friction(chain, w, weights, work)
    add_frame(chain, q, w, a, weights, work)
    add_contacts(chain, laws, w, weights, work)
    add_hinge_laws(chain, laws, state, elapsed, q, w, a, weights, work)
    add_link_laws(chain, laws, state, w, weights, work)


@jit_inline
def add_shaft_row(chain: Chain, q: Floats, w: Floats, a: Floats, work: Work) -> None:
    """Writes row 0 of inertia, weight and hinges, the shaft torque; the other rows are not
    computed. `q`, `w` and `a` are (c,).
    """
    R = work.R
    sin = work.sin
    cos = work.cos
    for i in range(q.size):
        R[i] = 0.0
    torque = (
        chain.moment[0, 0] * a[0]
        - chain.gravity * chain.first_moment[0] * cos[0]
        + chain.gravity_along * chain.first_moment[0] * sin[0]
    )
    for j in range(1, chain.length.size):
        c = cos[0] * cos[j] + sin[0] * sin[j]
        s = sin[0] * cos[j] - cos[0] * sin[j]
        torque += chain.moment[0, j] * (c * a[j] + s * w[j] * w[j])
    if chain.length.size > 1:
        # The shaft carries the reaction of hinge 1; the hinges beyond it reach row 0 only through
        # the inertia.
        elastic, _ = spring(chain, 1, q[1] - q[0] - chain.rest[1])
        torque -= elastic + chain.hinge_damping[1] * (w[1] - w[0])
    R[0] = torque


@jit_inline
def measure(
    chain: Chain,
    laws: Laws,
    state: State,
    elapsed: float,
    q: Floats,
    w: Floats,
    a: Floats,
    work: Work,
    force: Floats,
) -> None:
    """Writes `force` (3,) = fy, fz, shaft torque of the leg on its mount, in the sensor's axes (z
    down, y against the plane's y).

    `q`, `w` and `a` are (c,).
    """
    # fy and fz follow from the momentum of the whole leg, and the torque from row 0: the full
    # residual is not needed.
    prepare_pose(chain, q, work)
    add_shaft_row(chain, q, w, a, work)
    add_surroundings(chain, laws, state, elapsed, q, w, a, None, work)
    force[0] = -chain.total_mass * chain.gravity_along - work.outside[0]
    force[1] = chain.total_mass * chain.gravity + work.outside[1]
    force[2] = work.R[0]
    if q.size > chain.length.size:
        # The frame's part that stands between sensor and shaft accelerates with the leg.
        carried = (chain.total_mass + chain.frame_on_sensor * chain.frame_mass) * a[
            chain.length.size
        ]
        force[0] += carried * chain.frame_aside
        force[1] -= carried * chain.frame_down
    for i in range(chain.length.size):
        sin = work.sin[i]
        cos = work.cos[i]
        ww = w[i] * w[i]
        N = work.contact[0, i]
        F = work.contact[1, i]
        # N and F act across and along the floor under this end, which a bump turns against the
        # level floor.
        level_cos, level_sin = find_slope_direction(chain, i, work)
        floor_cos = chain.floor_cos * level_cos + chain.floor_sin * level_sin
        floor_sin = chain.floor_sin * level_cos - chain.floor_cos * level_sin
        force[0] += chain.first_moment[i] * (-sin * a[i] - cos * ww) - F * floor_cos - N * floor_sin
        force[1] -= chain.first_moment[i] * (cos * a[i] - sin * ww) + N * floor_cos - F * floor_sin


# Inlined functions have no entry point of their own; these two are for callers in Python.
assemble_once = jit(assemble)
measure_once = jit(measure)


def mechanical_energy_J(chain: Chain, q_rad: Floats, w_rad_s: Floats) -> Floats:
    """Energy of motion, weight, springs and compressed floor, (m,) [J], for angles and speeds (m,
    n).

    Energy that effects store (a yielding frame, a second spring) is not included, nor that of
    stretched sticking contacts, a few mJ.
    """
    return (
        kinetic_J(chain, q_rad, w_rad_s)
        + height_J(chain, q_rad)
        + springs_J(chain, q_rad)
        + floor_J(chain, q_rad)
    )


def kinetic_J(chain: Chain, q_rad: Floats, w_rad_s: Floats) -> Floats:
    """Kinetic energy (m,) of angles and speeds (m, n): w M(q) w / 2 with M_ij = c_ij cos(q_i -
    q_j), as in `forces`.
    """
    # cos(q_i - q_j) = cos cos + sin sin, so no (m, n, n) array of differences is needed.
    cos = w_rad_s * np.cos(q_rad)
    sin = w_rad_s * np.sin(q_rad)
    return np.asarray(
        0.5
        * (
            np.einsum("mi,ij,mj->m", cos, chain.moment, cos)
            + np.einsum("mi,ij,mj->m", sin, chain.moment, sin)
        )
    )


def height_J(chain: Chain, q_rad: Floats) -> Floats:
    """Potential energy (m,) of the weight for angles (m, n): zero with all links level."""
    return np.asarray(
        -(chain.gravity * np.sin(q_rad) + chain.gravity_along * np.cos(q_rad)) @ chain.first_moment
    )


def springs_J(chain: Chain, q_rad: Floats) -> Floats:
    """Energy (m,) of the hinge springs for angles (m, n): k0 phi^2 / 2 + k0 k2 phi^4 / 4 each,
    or the integral of the spline.
    """
    phi = np.diff(q_rad, axis=1) - chain.rest[1:]
    if chain.spring_origin.size:
        return np.asarray(
            SplineTable(chain.spring_origin[1:], chain.spring_cubic[1:]).energy(phi) @ chain.k0[1:]
        )
    phi2 = phi**2
    return np.asarray((phi2 * (0.5 + 0.25 * chain.k2[1:] * phi2)) @ chain.k0[1:])


def floor_J(chain: Chain, q_rad: Floats) -> Floats:
    """Energy (m,) of the compressed floor for angles (m, n): 2/5 stiffness depth^2.5 under every
    link end, on a bump where there is one.
    """
    sin = np.sin(q_rad)
    cos = np.cos(q_rad)
    up = chain.ground_depth * chain.floor_cos - np.cumsum(
        chain.length * (sin * chain.floor_cos - cos * chain.floor_sin), axis=1
    )
    if chain.bump_height != 0.0:
        y = np.cumsum(chain.length * (cos * chain.floor_cos + sin * chain.floor_sin), axis=1)
        fill_distances(chain, y, up.copy(), up)
    depth = chain.radius - up
    return np.asarray(0.4 * chain.contact_stiffness * (np.maximum(depth, 0.0) ** 2.5).sum(axis=1))
