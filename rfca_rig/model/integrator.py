"""The error-controlled implicit step that carries the chain through a stroke. Symbols as in `state`.

Two-stage DIRK with gamma = 1 - 1/sqrt(2): second order, L-stable and stiffly accurate, so the accelerations (and with them the
forces) at the end of a step satisfy the equations of motion exactly. Hairer & Wanner, Solving ODEs II, section IV.6.
"""

import numpy as np

from rfca_rig.model.compiled import compiled
from rfca_rig.model.contact import drag_anchors
from rfca_rig.model.forces import assemble, call_hinge, measure
from rfca_rig.model.linear import solve
from rfca_rig.model.shaft import close_shaft_row, place
from rfca_rig.model.state import Chain, Floats, Laws, Samples, Shaft, State, Work

GAMMA = 1.0 - 1.0 / np.sqrt(2.0)
NEWTON_LIMIT = 8  # a step that needs more iterations is cheaper to repeat at half the length
NEWTON_SHARE = 1e-2  # of the speed tolerance: the last, quadratic update is far below what it leaves
ABSURD_RAD_S2 = 1e15
PER_METRE = 100.0  # a frame's micrometre counts as much as a link's 0.1 mrad does at 10 mm
SHORTEST_STEP_S = 1e-10
FIRST_STEP_S = 1e-4


DONE, STEP_TOO_SHORT = 0, 1


@compiled
def room_to_work(coordinates: int, links: int) -> Work:
    """Scratch for a chain of so many links and coordinates."""
    v, u = np.zeros((10, coordinates)), np.zeros((2, links))
    contact, force, exchange = np.zeros((2, 2, links)), np.zeros((2, 3)), np.zeros((2, 8))
    return Work(
        R=np.zeros(coordinates),
        J=np.zeros((coordinates, coordinates)),
        sin=v[0],
        cos=v[1],
        down=u[0],
        along=u[1],
        arm=v[2],
        q=v[3],
        w=v[4],
        a=v[5],
        w_mid=v[6],
        a_mid=v[7],
        base_q=v[8],
        base_w=v[9],
        contact_old=contact[0],
        contact=contact[1],
        force_old=force[0],
        force=force[1],
        place=np.zeros((links, 4)),
        outside=np.zeros(2),
        x=exchange[0],
        out=exchange[1],
    )


@compiled
def stage(
    chain: Chain,
    laws: Laws | None,
    shaft: Shaft,
    state: State,
    elapsed: float,
    t: float,
    base_q: Floats,
    base_w: Floats,
    g: float,
    newton: float,
    work: Work,
) -> bool:
    """One implicit stage in `work`: a with R(base_q + g w, base_w + g a, a) = 0. True when Newton's iteration converged."""
    q, w, a = work.q, work.w, work.a
    for _ in range(NEWTON_LIMIT):
        place(shaft, t, base_q, base_w, g, q, w, a)
        assemble(chain, laws, state, elapsed, q, w, a, 1.0, g, g * g, work)
        close_shaft_row(shaft, t, q, w, a, g, work.R, work.J)
        if not solve(work.J, work.R):
            return False
        change = 0.0
        for i in range(q.size):
            a[i] -= work.R[i]
            change = max(change, abs(work.R[i]))
        if not change < ABSURD_RAD_S2:
            return False
        if g * change < newton:
            place(shaft, t, base_q, base_w, g, q, w, a)
            return True
    return False


@compiled
def try_step(chain: Chain, laws: Laws | None, shaft: Shaft, state: State, t: float, t_new: float, tolerance: Floats, work: Work) -> float:
    """A whole step into `work`. Returns its error in units of the tolerance, or infinity where a stage did not converge."""
    h = t_new - t
    g = GAMMA * h
    newton = NEWTON_SHARE * tolerance[1]
    work.a[:] = state.a
    if not stage(chain, laws, shaft, state, g, t + g, state.q, state.w, g, newton, work):
        return np.inf
    for i in range(state.q.size):
        work.w_mid[i], work.a_mid[i] = work.w[i], work.a[i]
        work.base_q[i] = state.q[i] + (h - g) * work.w[i]
        work.base_w[i] = state.w[i] + (h - g) * work.a[i]
    if not stage(chain, laws, shaft, state, h, t_new, work.base_q, work.base_w, g, newton, work):
        return np.inf
    error = 1e-12
    for i in range(state.q.size):
        weight = g if i < state.anchor.size else g * PER_METRE
        angle, speed = weight * abs(work.w[i] - work.w_mid[i]), weight * abs(work.a[i] - work.a_mid[i])
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
        for i in range(state.anchor.size):
            for side in range(2):
                old = work.contact_old[side, i]
                out.contact[first, side, i] = old + x * (work.contact[side, i] - old)
        for i in range(3):
            out.force[first, i] = work.force_old[i] + x * (work.force[i] - work.force_old[i])
        first += 1
    return first


@compiled
def remember(chain: Chain, laws: Laws | None, state: State, h: float, work: Work) -> None:
    """Lets the hinge laws with memory take in the step of length h that ends in `work`."""
    if laws is None:
        return
    for m in range(laws.place.size):
        if laws.advance[m] != 0:
            for i in range(1, chain.length.size):
                if laws.only[m] in (-1, i):
                    call_hinge(chain, laws, laws.advance[m], m, i, state, h, work.q, work.w, work)


@compiled
def accept(chain: Chain, laws: Laws | None, state: State, t: float, t_new: float, first: int, work: Work, out: Samples) -> int:
    """Takes over the step in `work`: samples, anchors, memory, state. Returns the next sample's index."""
    measure(chain, laws, state, t_new - t, work.q, work.w, work.a, work, work.force)
    first = fill_samples(state, work, t, t_new, first, out)
    drag_anchors(chain, state, work.q, work)
    remember(chain, laws, state, t_new - t, work)
    state.q[:], state.w[:], state.a[:] = work.q, work.w, work.a
    work.force_old[:], work.contact_old[:] = work.force, work.contact
    return first


@compiled
def integrate(
    chain: Chain,
    laws: Laws | None,
    shaft: Shaft,
    state: State,
    t: float,
    t_end: float,
    h: float,
    longest: float,
    tolerance: Floats,
    out: Samples,
) -> tuple[int, float, int, int]:
    """Carries `state` from t to t_end in place and fills `out` (times ascending, in (t, t_end]).

    `tolerance` = (rad, rad/s) per step. A step whose Newton iteration fails, or whose error is too large, is repeated shorter:
    nothing is accepted unconverged. Steps end on `shaft.landings`, where the acceleration jumps. Returns (status, last step
    length, accepted steps, rejected steps).
    """
    work = room_to_work(state.q.size, state.anchor.size)
    measure(chain, laws, state, 0.0, state.q, state.w, state.a, work, work.force_old)
    work.contact_old[:] = work.contact
    sample = landing = accepted = rejected = 0
    while t < t_end:
        while landing < shaft.landings.size and shaft.landings[landing] <= t:
            landing += 1
            h = min(h, FIRST_STEP_S)
        stop = min(t_end, shaft.landings[landing]) if landing < shaft.landings.size else t_end
        h = min(h, longest)
        t_new = stop if stop - t <= 1.0000001 * h else t + min(h, 0.5 * (stop - t))
        error = try_step(chain, laws, shaft, state, t, t_new, tolerance, work)
        if error > 1.0:
            rejected += 1
            h = (t_new - t) * (0.5 if np.isinf(error) else max(0.2, 0.9 / np.sqrt(error)))
            if h < SHORTEST_STEP_S:
                return STEP_TOO_SHORT, h, accepted, rejected
            continue
        sample = accept(chain, laws, state, t, t_new, sample, work, out)
        accepted += 1
        longer = (t_new - t) * min(3.0, 0.9 / np.sqrt(error))
        h = max(h, longer) if t_new - t < h else longer  # a step cut short by a landing says nothing against h
        t = t_new
    return DONE, h, accepted, rejected
