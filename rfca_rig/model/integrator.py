"""The error-controlled implicit step that carries the chain through a stroke. Symbols as in `state`.

Two-stage DIRK with gamma = 1 - 1/sqrt(2): second order, L-stable and stiffly accurate, so the accelerations (and with them the
forces) at the end of a step satisfy the equations of motion exactly. Hairer & Wanner, Solving ODEs II, section IV.6.
"""

import numpy as np

from rfca_rig.model.compiled import compiled
from rfca_rig.model.contact import drag_anchors
from rfca_rig.model.forces import assemble, measure
from rfca_rig.model.linear import solve
from rfca_rig.model.shaft import close_shaft_row, place
from rfca_rig.model.state import Chain, Floats, Samples, Shaft, State, Work

GAMMA = 1.0 - 1.0 / np.sqrt(2.0)
NEWTON_LIMIT = 8  # a step that needs more iterations is cheaper to repeat at half the length
SHORTEST_STEP_S = 1e-10
FIRST_STEP_S = 1e-4


DONE, STEP_TOO_SHORT = 0, 1


@compiled
def room_to_work(n: int) -> Work:
    """Scratch for a chain of n links."""
    v = np.zeros((9, n))
    contact, force = np.zeros((2, 2, n)), np.zeros((2, 3))
    return Work(
        np.zeros(n), np.zeros((n, n)), v[0], v[1], v[2], v[3], v[4], v[5], v[6], v[7], v[8], contact[0], contact[1], force[0], force[1]
    )


@compiled
def stage(
    chain: Chain,
    shaft: Shaft,
    t: float,
    base_q: Floats,
    base_w: Floats,
    anchor: Floats,
    g: float,
    newton: float,
    q: Floats,
    w: Floats,
    a: Floats,
    work: Work,
) -> bool:
    """One implicit stage: a with R(base_q + g w, base_w + g a, a) = 0. True when Newton's iteration converged."""
    for _ in range(NEWTON_LIMIT):
        place(shaft, t, base_q, base_w, g, q, w, a)
        assemble(chain, q, w, a, anchor, 1.0, g, g * g, work)
        close_shaft_row(shaft, q, w, a, g, work.R, work.J)
        if not solve(work.J, work.R):
            return False
        change = 0.0
        for i in range(q.size):
            a[i] -= work.R[i]
            change = max(change, abs(work.R[i]))
        if not change < 1e15:
            return False
        if g * change < newton:
            place(shaft, t, base_q, base_w, g, q, w, a)
            return True
    return False


@compiled
def try_step(chain: Chain, shaft: Shaft, state: State, t: float, t_new: float, tolerance: Floats, work: Work) -> float:
    """A whole step into `work`. Returns its error in units of the tolerance, or infinity where a stage did not converge."""
    h = t_new - t
    g = GAMMA * h
    newton = 1e-2 * tolerance[1]
    work.a[:] = state.a
    if not stage(chain, shaft, t + g, state.q, state.w, state.anchor, g, newton, work.q, work.w, work.a, work):
        return np.inf
    for i in range(state.q.size):
        work.w_mid[i], work.a_mid[i] = work.w[i], work.a[i]
        work.base_q[i] = state.q[i] + (h - g) * work.w[i]
        work.base_w[i] = state.w[i] + (h - g) * work.a[i]
    if not stage(chain, shaft, t_new, work.base_q, work.base_w, state.anchor, g, newton, work.q, work.w, work.a, work):
        return np.inf
    error = 1e-12
    for i in range(state.q.size):
        angle, speed = g * abs(work.w[i] - work.w_mid[i]), g * abs(work.a[i] - work.a_mid[i])
        error = max(error, angle / tolerance[0], speed / tolerance[1])
    return error


@compiled
def fill_samples(state: State, work: Work, t: float, t_new: float, first: int, out: Samples) -> int:
    """Samples inside (t, t_new]: angles by cubic Hermite (order 4), the rest by straight lines (order 2)."""
    h = t_new - t
    while first < out.t.size and out.t[first] <= t_new:
        x = (out.t[first] - t) / h
        for i in range(state.q.size):
            rise, m0, m1 = work.q[i] - state.q[i], h * state.w[i], h * work.w[i]
            out.q[first, i] = state.q[i] + x * (m0 + x * (3.0 * rise - 2.0 * m0 - m1 + x * (m0 + m1 - 2.0 * rise)))
            out.w[first, i] = state.w[i] + x * (work.w[i] - state.w[i])
            for side in range(2):
                old = work.contact_old[side, i]
                out.contact[first, side, i] = old + x * (work.contact[side, i] - old)
        for i in range(3):
            out.force[first, i] = work.force_old[i] + x * (work.force[i] - work.force_old[i])
        first += 1
    return first


@compiled
def accept(chain: Chain, state: State, t: float, t_new: float, first: int, work: Work, out: Samples) -> int:
    """Takes over the step in `work`: samples, anchors, state. Returns the next sample's index."""
    measure(chain, work.q, work.w, work.a, state.anchor, work, work.force)
    first = fill_samples(state, work, t, t_new, first, out)
    drag_anchors(chain, work.q, state.anchor, work.contact)
    state.q[:], state.w[:], state.a[:] = work.q, work.w, work.a
    work.force_old[:], work.contact_old[:] = work.force, work.contact
    return first


@compiled
def integrate(
    chain: Chain, shaft: Shaft, state: State, t: float, t_end: float, h: float, longest: float, tolerance: Floats, out: Samples
) -> tuple[int, float, int, int]:
    """Carries `state` from t to t_end in place and fills `out` (times ascending, in (t, t_end]).

    Error-controlled two-stage DIRK (order 2, L-stable); `tolerance` = (rad, rad/s) per step. A step whose Newton iteration
    fails, or whose error is too large, is repeated shorter: nothing is accepted unconverged. Steps end on `shaft.landings`,
    where the acceleration jumps. Returns (status, last step length, accepted steps, rejected steps).
    """
    work = room_to_work(state.q.size)
    measure(chain, state.q, state.w, state.a, state.anchor, work, work.force_old)
    work.contact_old[:] = work.contact
    sample = landing = accepted = rejected = 0
    while t < t_end:
        while landing < shaft.landings.size and shaft.landings[landing] <= t:
            landing += 1
            h = min(h, FIRST_STEP_S)
        stop = min(t_end, shaft.landings[landing]) if landing < shaft.landings.size else t_end
        h = min(h, longest)
        t_new = stop if stop - t <= 1.0000001 * h else t + min(h, 0.5 * (stop - t))
        error = try_step(chain, shaft, state, t, t_new, tolerance, work)
        if error > 1.0:
            rejected += 1
            h = (t_new - t) * (0.5 if np.isinf(error) else max(0.2, 0.9 / np.sqrt(error)))
            if h < SHORTEST_STEP_S:
                return STEP_TOO_SHORT, h, accepted, rejected
            continue
        sample = accept(chain, state, t, t_new, sample, work, out)
        accepted += 1
        longer = (t_new - t) * min(3.0, 0.9 / np.sqrt(error))
        h = max(h, longer) if t_new - t < h else longer  # a step cut short by a landing says nothing against h
        t = t_new
    return DONE, h, accepted, rejected
