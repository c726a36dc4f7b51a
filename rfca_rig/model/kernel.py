"""The compiled planar chain: equations of motion, contact and the error-controlled implicit step.

Everything compiled stands in this one file, because the on-disk cache of the compiler does not notice an edit in another file.

Symbols, as in the paper's section III with absolute angles instead of relative ones:
    q_i      absolute angle of link i, from +y, positive downwards [rad]; q_0 is the shaft
    w_i, a_i its speed [rad/s] and acceleration [rad/s2]
    Y_k, D_k place of the distal end of link k: along the ground, and depth below the shaft [m]
    delta_k  = D_k + r - H, how deep the circle of radius r around that end is in the ground [m]
    s_k      = Y_k - r q_k, displacement of the circle's lowest point along the ground, rolling taken off [m]
    R        = M(q) a + h(q, w) - Q, the residual of the equations of motion [N m]; R_0 is the shaft torque
"""

import numpy as np
from numba import njit

GAMMA = 1.0 - 1.0 / np.sqrt(2.0)  # makes the two-stage DIRK second order and L-stable
NEWTON_LIMIT = 8  # a step that needs more iterations is cheaper to repeat at half the length
SHORTEST_STEP_S = 1e-10

# status of an integration
DONE, STEP_TOO_SHORT, NOT_FINITE = 0, 1, 2

# rows of `chain` scalars
RADIUS, GRAVITY, TOTAL_MASS, GROUND_DEPTH, STIFFNESS, DAMPING, MU, GRIP, GRIP_DAMPING = range(9)

# entries of `drive`: the shaft torque is FEED + K_ANGLE (ANGLE - q_0) + K_SPEED (SPEED - w_0)
DRIVEN_FREELY, ROTOR, FEED, K_ANGLE, ANGLE, K_SPEED, SPEED = range(7)


@njit(cache=True, nogil=True)
def normal_force(scalar, depth, rate):
    """Hertz with damping: (N, dN/d depth, dN/d rate) for a circle `depth` deep, sinking at `rate`."""
    grow = 1.0 + scalar[DAMPING] * max(rate, 0.0)
    if depth <= 0.0 or grow <= 0.0:
        return 0.0, 0.0, 0.0
    root = np.sqrt(depth)
    hertz = scalar[STIFFNESS] * depth * root
    return hertz * grow, 1.5 * scalar[STIFFNESS] * root * grow, hertz * scalar[DAMPING]


@njit(cache=True, nogil=True)
def tangential_force(scalar, stretch, slip, normal):
    """Coulomb friction with stick as a state, eq. (19): (F, dF/d stretch, dF/d slip, dF/dN).

    The lowest point is tied to an anchor by a stiff spring; beyond mu N the anchor is dragged along. A leg at rest
    keeps its force for ever, which a law in the sliding speed alone would let creep to zero.
    """
    spring = -scalar[GRIP] * stretch
    limit = scalar[MU] * normal
    drag = scalar[GRIP_DAMPING]
    if spring > limit:
        return limit - drag * slip, 0.0, -drag, scalar[MU]
    if spring < -limit:
        return -limit - drag * slip, 0.0, -drag, -scalar[MU]
    return spring - drag * slip, -scalar[GRIP], -drag, 0.0


@njit(cache=True, nogil=True)
def add_inertia(moment, q, w, a, ca, cw, cq, R, J):
    """R += M a + h; J += ca M + cw dR/dw + cq dR/dq. `moment` (n, n) holds the coupling constants, inertia on its diagonal."""
    n = q.size
    sin, cos = np.sin(q), np.cos(q)
    for i in range(n):
        R[i] += moment[i, i] * a[i]
        J[i, i] += ca * moment[i, i]
        for j in range(i):
            c = moment[i, j] * (cos[i] * cos[j] + sin[i] * sin[j])
            s = moment[i, j] * (sin[i] * cos[j] - cos[i] * sin[j])
            R[i] += c * a[j] + s * w[j] * w[j]
            R[j] += c * a[i] - s * w[i] * w[i]
            from_j = cq * (s * a[j] - c * w[j] * w[j])
            from_i = cq * (s * a[i] + c * w[i] * w[i])
            J[i, j] += ca * c + cw * 2.0 * s * w[j] + from_j
            J[j, i] += ca * c - cw * 2.0 * s * w[i] - from_i
            J[i, i] -= from_j
            J[j, j] += from_i


@njit(cache=True, nogil=True)
def add_gravity_and_hinges(scalar, link, q, w, cw, cq, R, J):
    """Weight of the links and the hinge torques k0 phi + k0 k2 phi^3 + c phi'. `link` rows: length, first moment, k0, k2, c."""
    g = scalar[GRAVITY]
    for i in range(q.size):
        R[i] -= g * link[1, i] * np.cos(q[i])
        J[i, i] += cq * g * link[1, i] * np.sin(q[i])
    for i in range(1, q.size):
        phi = q[i] - q[i - 1]
        k0, k2, c = link[2, i], link[3, i], link[4, i]
        torque = k0 * phi * (1.0 + k2 * phi * phi) + c * (w[i] - w[i - 1])
        slope = cq * k0 * (1.0 + 3.0 * k2 * phi * phi) + cw * c
        R[i] += torque
        R[i - 1] -= torque
        J[i, i] += slope
        J[i - 1, i - 1] += slope
        J[i, i - 1] -= slope
        J[i - 1, i] -= slope


@njit(cache=True, nogil=True)
def add_contacts(scalar, link, q, w, anchor, cw, cq, R, J, normal, tangential):
    """Ground forces at every link end; fills `normal` and `tangential` (n,) [N]."""
    n, r = q.size, scalar[RADIUS]
    y = depth = slide = sink = 0.0
    down, along = np.empty(n), np.empty(n)  # dD/dq_j and dY/dq_j
    for k in range(n):
        down[k], along[k] = link[0, k] * np.cos(q[k]), -link[0, k] * np.sin(q[k])
        y += down[k]  # l cos q is also the run along y
        depth -= along[k]
        sink += down[k] * w[k]
        slide += along[k] * w[k]
        delta = depth + r - scalar[GROUND_DEPTH]
        if delta <= 0.0:
            normal[k] = tangential[k] = 0.0
            continue
        N, N_delta, N_rate = normal_force(scalar, delta, sink)
        F, F_s, F_v, F_N = tangential_force(scalar, y - r * q[k] - anchor[k], slide - r * w[k], N)
        normal[k], tangential[k] = N, F
        for i in range(k + 1):
            along_i = along[i] - (r if i == k else 0.0)
            R[i] -= -N * down[i] + F * along_i
            J[i, i] -= cq * (-N * along[i] - F * down[i])
            for j in range(k + 1):
                along_j = along[j] - (r if j == k else 0.0)
                dN = cq * (N_delta * down[j] + N_rate * along[j] * w[j]) + cw * N_rate * down[j]
                dF = cq * (F_s * along_j - F_v * down[j] * w[j]) + cw * F_v * along_j + F_N * dN
                J[i, j] -= -dN * down[i] + dF * along_i


@njit(cache=True, nogil=True)
def assemble(scalar, link, moment, q, w, a, anchor, ca, cw, cq, R, J, normal, tangential):
    """Residual R of the equations of motion and J = ca dR/da + cw dR/dw + cq dR/dq."""
    R[:] = 0.0
    J[:] = 0.0
    add_inertia(moment, q, w, a, ca, cw, cq, R, J)
    add_gravity_and_hinges(scalar, link, q, w, cw, cq, R, J)
    add_contacts(scalar, link, q, w, anchor, cw, cq, R, J, normal, tangential)


@njit(cache=True, nogil=True)
def solve(J, R):
    """Solves J x = R in place (x is left in R) by elimination with row exchange; False where J is singular."""
    n = R.size
    for k in range(n):
        p = k
        for i in range(k + 1, n):
            if abs(J[i, k]) > abs(J[p, k]):
                p = i
        if not abs(J[p, k]) > 0.0:
            return False
        if p != k:
            for j in range(k, n):
                J[k, j], J[p, j] = J[p, j], J[k, j]
            R[k], R[p] = R[p], R[k]
        for i in range(k + 1, n):
            f = J[i, k] / J[k, k]
            if f != 0.0:
                for j in range(k + 1, n):
                    J[i, j] -= f * J[k, j]
                R[i] -= f * R[k]
    for k in range(n - 1, -1, -1):
        for j in range(k + 1, n):
            R[k] -= J[k, j] * R[j]
        R[k] /= J[k, k]
    return True


@njit(cache=True, nogil=True)
def shaft_at(breaks, coefficient, t):
    """(angle, speed, acceleration) of a piecewise cubic; at a break the piece that ends there counts."""
    i = min(max(np.searchsorted(breaks, t) - 1, 0), coefficient.shape[0] - 1)
    c, x = coefficient[i], t - breaks[i]
    return (
        c[0] + x * (c[1] + x * (c[2] + x * c[3])),
        c[1] + x * (2.0 * c[2] + x * 3.0 * c[3]),
        2.0 * c[2] + 6.0 * c[3] * x,
    )


@njit(cache=True, nogil=True)
def close_shaft_row(drive, shaft, q, w, a, g, R, J):
    """Row 0 under what drives the shaft, eq. (16): a known acceleration in place of the unknown one, or a torque."""
    if drive[DRIVEN_FREELY] == 0.0:
        R[0] = a[0] - shaft[2]
        J[0, :] = 0.0
        J[0, 0] = 1.0
        return
    torque = drive[FEED] + drive[K_ANGLE] * (drive[ANGLE] - q[0]) + drive[K_SPEED] * (drive[SPEED] - w[0])
    R[0] += drive[ROTOR] * a[0] - torque
    J[0, 0] += drive[ROTOR] + g * drive[K_SPEED] + g * g * drive[K_ANGLE]


@njit(cache=True, nogil=True)
def stage(scalar, link, moment, drive, shaft, anchor, base_q, base_w, g, tolerance, q, w, a, R, J, normal, tangential):
    """One implicit stage: a with R(base_q + g w, base_w + g a, a) = 0. True when Newton's iteration converged."""
    for iteration in range(NEWTON_LIMIT):
        for i in range(q.size):
            w[i] = base_w[i] + g * a[i]
            q[i] = base_q[i] + g * w[i]
        if drive[DRIVEN_FREELY] == 0.0:
            q[0], w[0], a[0] = shaft
        assemble(scalar, link, moment, q, w, a, anchor, 1.0, g, g * g, R, J, normal, tangential)
        close_shaft_row(drive, shaft, q, w, a, g, R, J)
        if not solve(J, R):
            return False
        change = 0.0
        for i in range(q.size):
            a[i] -= R[i]
            change = max(change, abs(R[i]))
        if not change < 1e15:
            return False
        if g * change < tolerance:
            for i in range(q.size):
                w[i] = base_w[i] + g * a[i]
                q[i] = base_q[i] + g * w[i]
            if drive[DRIVEN_FREELY] == 0.0:
                q[0], w[0], a[0] = shaft
            return True
    return False


@njit(cache=True, nogil=True)
def drag_anchors(scalar, link, q, anchor, normal):
    """After a step: the anchors of slipping ends follow, those of ends in the air wait right below them."""
    y = 0.0
    for k in range(q.size):
        y += link[0, k] * np.cos(q[k])
        s = y - scalar[RADIUS] * q[k]
        reach = scalar[MU] * max(normal[k], 0.0) / scalar[GRIP]
        anchor[k] = min(max(anchor[k], s - reach), s + reach)


@njit(cache=True, nogil=True)
def measure(scalar, link, moment, q, w, a, anchor, R, J, normal, tangential, out):
    """out = (fy, fz, shaft torque): what the leg does to its mount, in the sensor's axes (z down, y against the plane's y)."""
    assemble(scalar, link, moment, q, w, a, anchor, 0.0, 0.0, 0.0, R, J, normal, tangential)
    out[0], out[1], out[2] = 0.0, scalar[TOTAL_MASS] * scalar[GRAVITY], R[0]
    for i in range(q.size):
        sin, cos, ww = np.sin(q[i]), np.cos(q[i]), w[i] * w[i]
        out[0] += link[1, i] * (-sin * a[i] - cos * ww) - tangential[i]
        out[1] -= link[1, i] * (cos * a[i] - sin * ww) + normal[i]


@njit(cache=True, nogil=True)
def settle(scalar, link, moment, q, tolerance):
    """Static equilibrium with the shaft held at q[0], starting from q, by damped Newton. True when found."""
    n = q.size
    R, J, zero = np.empty(n), np.empty((n, n)), np.zeros(n)
    normal, tangential, anchor = np.zeros(n), np.zeros(n), np.zeros(n)
    grip_free = scalar.copy()
    grip_free[MU] = 0.0
    for iteration in range(200):
        assemble(grip_free, link, moment, q, zero, zero, anchor, 0.0, 0.0, 1.0, R, J, normal, tangential)
        R[0] = 0.0
        J[0, :] = 0.0
        J[0, 0] = 1.0
        if not solve(J, R):
            return False
        change = np.max(np.abs(R))
        q -= R * min(1.0, 0.1 / max(change, 1e-300))
        if change < tolerance:
            return True
    return False


@njit(cache=True, nogil=True)
def fill_samples(t, h, before, after, q0, w0, q1, w1, contact0, contact1, times, first, Q, W, force, contact):
    """Samples inside (t, t + h]: angles by cubic Hermite (order 4), forces by straight lines (order 2)."""
    while first < times.size and times[first] <= t + h:
        x = (times[first] - t) / h
        for i in range(q0.size):
            rise = q1[i] - q0[i]
            m0, m1 = h * w0[i], h * w1[i]
            Q[first, i] = q0[i] + x * (m0 + x * (3.0 * rise - 2.0 * m0 - m1 + x * (m0 + m1 - 2.0 * rise)))
            W[first, i] = w0[i] + x * (w1[i] - w0[i])
            for side in range(2):
                contact[first, side, i] = contact0[side, i] + x * (contact1[side, i] - contact0[side, i])
        for i in range(3):
            force[first, i] = before[i] + x * (after[i] - before[i])
        first += 1
    return first


@njit(cache=True, nogil=True)
def integrate(
    scalar, link, moment, drive, breaks, coefficient, landings, t, t_end, h, h_most, tolerance, q, w, a, anchor, times, Q, W, force, contact
):
    """Carries (q, w, a, anchor) from t to t_end in place and fills the samples at `times` (ascending, in (t, t_end]).

    Error-controlled two-stage DIRK (order 2, L-stable); `tolerance` = (rad, rad/s) per step. A step whose Newton iteration
    fails, or whose error is too large, is repeated shorter: nothing is accepted unconverged. Steps land on `landings`,
    where the shaft's acceleration jumps. Returns (status, last step length, accepted steps, rejected steps).
    """
    n = q.size
    R, J = np.empty(n), np.empty((n, n))
    base_q, base_w = np.empty(n), np.empty(n)
    q1, w1, a1 = np.empty(n), np.empty(n), a.copy()
    q2, w2, a2 = np.empty(n), np.empty(n), a.copy()
    c_old, c_new = np.zeros((2, n)), np.zeros((2, n))
    before, after = np.empty(3), np.empty(3)
    measure(scalar, link, moment, q, w, a, anchor, R, J, c_old[0], c_old[1], before)
    newton = 1e-4 * tolerance[1]
    sample = landing = accepted = rejected = 0
    while t < t_end:
        while landing < landings.size and landings[landing] <= t:
            landing += 1
        stop = t_end
        if landing < landings.size:
            stop = min(stop, landings[landing])
        left = stop - t
        h = min(h, h_most)
        step = left if left <= h * 1.0000001 else (0.5 * left if left < 2.0 * h else h)
        g = GAMMA * step
        t_new = stop if step == left else t + step
        shaft = shaft_at(breaks, coefficient, t + g)
        ok = stage(scalar, link, moment, drive, shaft, anchor, q, w, g, newton, q1, w1, a1, R, J, c_new[0], c_new[1])
        if ok:
            for i in range(n):
                base_q[i] = q[i] + (1.0 - GAMMA) * step * w1[i]
                base_w[i] = w[i] + (1.0 - GAMMA) * step * a1[i]
                a2[i] = a1[i]
            shaft = shaft_at(breaks, coefficient, t_new)
            ok = stage(scalar, link, moment, drive, shaft, anchor, base_q, base_w, g, newton, q2, w2, a2, R, J, c_new[0], c_new[1])
        error = 4.0
        if ok:
            error = 1e-12
            for i in range(n):
                error = max(error, g * abs(w2[i] - w1[i]) / tolerance[0], g * abs(a2[i] - a1[i]) / tolerance[1])
        if error > 1.0 or not ok:
            rejected += 1
            h = step * (0.5 if not ok else max(0.2, 0.9 / np.sqrt(error)))
            a1[:] = a
            if h < SHORTEST_STEP_S:
                return STEP_TOO_SHORT, h, accepted, rejected
            continue
        if not np.isfinite(error):
            return NOT_FINITE, h, accepted, rejected
        measure(scalar, link, moment, q2, w2, a2, anchor, R, J, c_new[0], c_new[1], after)
        sample = fill_samples(t, step, before, after, q, w, q2, w2, c_old, c_new, times, sample, Q, W, force, contact)
        drag_anchors(scalar, link, q2, anchor, c_new[0])
        q[:], w[:], a[:] = q2, w2, a2
        a1[:] = a2
        before[:], c_old[:] = after, c_new
        accepted += 1
        if t_new == stop and stop < t_end:
            h = min(h, 1e-4)
        else:
            h = step * min(3.0, 0.9 / np.sqrt(error)) if step >= 0.5 * h else h
        t = t_new
    return DONE, h, accepted, rejected
