"""Integrates the chain over time by an error-controlled implicit Runge-Kutta method. Symbols as in
`state`.

Kvaerno's ESDIRK 3/2 with four stages, the first explicit: third order, L-stable and stiffly
accurate, so the accelerations (and with them the forces) at the end of a step satisfy the equations
of motion exactly. Its third stage is a solution of second order at the end of the step, L-stable
too; the difference is the error. A. Kvaerno, Singly diagonally implicit Runge-Kutta methods with an
explicit first stage, BIT 44 (2004).

Output between the two ends of a step: angles and speeds by cubic Hermite interpolation, forces by
the laws.
"""

import numpy as np

from rfca_rig.model.kernel.compiled import jit, jit_inline, jit_internal
from rfca_rig.model.kernel.contact import (
    limit_step_to_reversal,
    locate_ends,
    store_ends,
    update_friction_anchors,
)
from rfca_rig.model.kernel.forces import call_hinge, measure, prepare_pose
from rfca_rig.model.kernel.lanes import highest, view_fields, view_lanes
from rfca_rig.model.kernel.stage import shaft_at, solve_stage
from rfca_rig.model.kernel.state import Chain, Floats, Laws, Samples, Shaft, State, Work

G = 0.43586652150845967
STAGES = 4
# Kvaerno (2004), the method ESDIRK 3/2: its abscissae and rows as functions of gamma, here G. The
# diagonal entry G is not in the table.
TABLEAU = np.array(
    [
        [0.0, 0.0, 0.0],
        [G, 0.0, 0.0],
        [(-4.0 * G * G + 6.0 * G - 1.0) / (4.0 * G), (1.0 - 2.0 * G) / (4.0 * G), 0.0],
        [
            (6.0 * G - 1.0) / (12.0 * G),
            -1.0 / ((24.0 * G - 12.0) * G),
            (-6.0 * G * G + 6.0 * G - 1.0) / (6.0 * G - 3.0),
        ],
    ]
)
NODES = np.array([0.0, 2.0 * G, 1.0, 1.0])
# Newton's iteration stops at this share of the speed tolerance: forces within a step depend on the
# speeds at its ends.
NEWTON_SHARE = 2e-3
# Weight of a frame's displacement in the error: 0.1 um counts as much as 10 urad of a link, the
# default tolerance.
PER_METRE = 100.0
SHORTEST_STEP_S = 1e-10
FIRST_STEP_S = 1e-4
GAIN_BY_TURN = 0.98  # a step is not repeated for less
# At a break the earlier piece of the shaft's motion counts, so the motion after a jump is read a
# moment later.
JUST_AFTER_S = 1e-12

DONE = 0
STEP_TOO_SHORT = 1
TOO_MANY_STEPS = 2


@jit_inline
def interpolate(state: State, end: int, h: float, x: float, work: Work) -> None:
    """Interpolates q, w, a at the share x of a step of length h from `state` to stage `end` into
    `work`: order 4 for q and w, 3 for a.
    """
    q1 = work.stage_q[end]
    w1 = work.stage_w[end]
    a1 = work.stage_a[end]
    for i in range(state.q.size):
        rise = q1[i] - state.q[i]
        m0 = h * state.w[i]
        m1 = h * w1[i]
        work.q[i] = state.q[i] + x * (
            m0 + x * (3.0 * rise - 2.0 * m0 - m1 + x * (m0 + m1 - 2.0 * rise))
        )
        rise = w1[i] - state.w[i]
        m0 = h * state.a[i]
        m1 = h * a1[i]
        c2 = 3.0 * rise - 2.0 * m0 - m1
        c3 = m0 + m1 - 2.0 * rise
        work.w[i] = state.w[i] + x * (m0 + x * (c2 + x * c3))
        work.a[i] = (m0 + x * (2.0 * c2 + x * 3.0 * c3)) / h


@jit_internal
def fill_samples(
    chain: Chain,
    laws: Laws,
    state: State,
    t: float,
    t_new: float,
    first: int,
    work: Work,
    out: Samples,
) -> int:
    """Fills the samples inside (t, t_new], from `state` to the last stage. Returns the next
    sample's index.
    """
    h = t_new - t
    end = work.stage_q.shape[0] - 1
    while first < out.t.size and out.t[first] <= t_new:
        elapsed = out.t[first] - t
        interpolate(state, end, h, elapsed / h, work)
        # Forces are not interpolated: contact and friction vary within a step more than a cubic can
        # follow.
        measure(chain, laws, state, elapsed, work.q, work.w, work.a, work, work.force)
        # A caller may want fewer columns than there are.
        for i in range(out.q.shape[1]):
            out.q[first, i] = work.q[i]
        for i in range(out.w.shape[1]):
            out.w[first, i] = work.w[i]
        for i in range(out.contact.shape[2]):
            out.contact[first, 0, i] = work.contact[0, i]
            out.contact[first, 1, i] = work.contact[1, i]
        for i in range(3):
            out.force[first, i] = work.force[i]
        first += 1
    return first


@jit_inline
def start(chain: Chain, laws: Laws, shaft: Shaft, state: State, t: float, work: Work) -> bool:
    """Solves for the accelerations at the angles and speeds of `state`, where those of the last
    step are invalid after a jump.
    """
    for i in range(state.q.size):
        work.base_q[i] = state.q[i]
        work.base_w[i] = state.w[i]
        work.a[i] = state.a[i]
        work.jerk[i] = 0.0
    for k in range(state.anchor.size):
        work.limit[2, k] = np.inf  # each tie carries what its stretch says
    # With g = 0 the residual is linear in the accelerations, so the first iteration of Newton
    # solves it and any limit accepts it.
    if not solve_stage(chain, laws, shaft, state, 0.0, t + JUST_AFTER_S, 0.0, 1.0, bool(0), work):
        return False
    for i in range(state.q.size):
        state.a[i] = work.a[i]
    if not shaft.free:
        _, state.w[0], state.a[0] = shaft_at(shaft, t + JUST_AFTER_S)
    locate_ends(chain, state, state.q, state.w, work)
    store_ends(chain, state, state.q, work)
    for k in range(state.anchor.size):
        work.limit[2, k] = work.limit[0, k]
    return True


@jit_inline
def predict(state: State, stage: int, h: float, work: Work) -> None:
    """Extrapolates a first guess of a stage's acceleration: from the last step's jerk, then from
    the previous stages.
    """
    a = work.stage_a
    for i in range(state.q.size):
        if stage == 1:
            work.a[i] = a[0, i] + NODES[1] * h * work.jerk[i]
        elif stage == 2:
            work.a[i] = a[1, i] + (a[1, i] - a[0, i]) * (1.0 - NODES[1]) / NODES[1]
        else:
            work.a[i] = a[2, i]


@jit_inline
def prepare(state: State, stage: int, h: float, work: Work) -> None:
    """Writes the explicit part of a stage, which follows from the stages before it, into
    `work.base_q` and `work.base_w`.
    """
    for i in range(state.q.size):
        q = state.q[i]
        w = state.w[i]
        for j in range(stage):
            q += h * TABLEAU[stage, j] * work.stage_w[j, i]
            w += h * TABLEAU[stage, j] * work.stage_a[j, i]
        work.base_q[i] = q
        work.base_w[i] = w


@jit_inline
def store_stage(stage: int, q: Floats, w: Floats, a: Floats, work: Work) -> None:
    """Stores `q`, `w` and `a` (c,) of a solved stage."""
    for i in range(q.size):
        work.stage_q[stage, i] = q[i]
        work.stage_w[stage, i] = w[i]
        work.stage_a[stage, i] = a[i]


@jit_inline
def try_step(
    chain: Chain,
    laws: Laws,
    shaft: Shaft,
    state: State,
    t: float,
    t_new: float,
    tolerance: Floats,
    work: Work,
) -> float:
    """Computes the stages of a step from t to t_new into `work`. Returns its error in units of
    `tolerance` (2,), in rad and rad/s.

    Returns infinity where a stage did not converge.
    """
    h = t_new - t
    store_stage(0, state.q, state.w, state.a, work)
    for stage in range(1, STAGES):
        predict(state, stage, h, work)
        prepare(state, stage, h, work)
        elapsed = NODES[stage] * h
        # The last two stages are at the end of the step: t_new itself, since rounding must not pass
        # a break of the shaft's motion.
        at = t_new if stage > 1 else t + elapsed
        if not solve_stage(
            chain,
            laws,
            shaft,
            state,
            elapsed,
            at,
            G * h,
            NEWTON_SHARE * tolerance[1],
            stage > 1,
            work,
        ):
            return np.inf
        store_stage(stage, work.q, work.w, work.a, work)
    # The third stage is the embedded solution of second order. The small start value avoids a
    # division by zero in the step control.
    error = 1e-12
    for i in range(state.q.size):
        weight = 1.0 if i < state.anchor.size else PER_METRE
        angle = abs(work.stage_q[3, i] - work.stage_q[2, i])
        speed = abs(work.stage_w[3, i] - work.stage_w[2, i])
        # The compiler knows the maximum of two lanes, not of three.
        error = max(error, weight * angle / tolerance[0])
        error = max(error, weight * speed / tolerance[1])
    return highest(error)


@jit_internal
def update_memory(chain: Chain, laws: Laws, state: State, h: float, work: Work) -> None:
    """Updates the memory of hinge laws after a step of length h [s] that ends in `work`."""
    for m in range(laws.place.size):
        if laws.advance[m] != 0:
            for i in range(1, chain.length.size):
                if laws.only[m] in (-1, i):
                    call_hinge(
                        chain, laws, laws.advance[m], m, i, state, h, work.q, work.w, work.a, work
                    )


# An internal function has no entry point of its own; this one is for callers in Python.
update_memory_once = jit(update_memory)


@jit_inline
def accept_step(
    chain: Chain,
    laws: Laws,
    state: State,
    t: float,
    t_new: float,
    first: int,
    work: Work,
    out: Samples,
) -> tuple[int, bool]:
    """Accepts the step in `work`: samples, anchors, memory, state. Returns the next sample's
    index, and whether forces jumped.
    """
    # Samples are interpolated with the state at the beginning of the step, so they come before the
    # state changes.
    for k in range(state.anchor.size):
        work.limit[1, k] = work.limit[0, k]
    first = fill_samples(chain, laws, state, t, t_new, first, work, out)
    h = t_new - t
    q = work.q
    w = work.w
    a = work.a
    old_w = state.w
    old_a = state.a
    for i in range(q.size):
        q[i] = work.stage_q[3, i]
        w[i] = work.stage_w[3, i]
        a[i] = work.stage_a[3, i]
        # Derivative at the step's end of the parabola through a at both ends whose integral is the
        # change of w.
        work.jerk[i] = (6.0 * (old_w[i] - w[i]) / h + 2.0 * old_a[i] + 4.0 * a[i]) / h
    prepare_pose(chain, q, work)
    locate_ends(chain, state, q, w, work)
    jumped = update_friction_anchors(chain, state, h, q, work)
    update_memory(chain, laws, state, h, work)
    for i in range(q.size):
        state.q[i] = q[i]
        state.w[i] = w[i]
        state.a[i] = a[i]
    return first, jumped


@jit_internal
def take_steps(
    chain: Chain,
    laws: Laws,
    shaft: Shaft,
    state: State,
    t: float,
    t_end: float,
    h: float,
    longest: float,
    most: int,
    tolerance: Floats,
    work: Work,
    out: Samples,
) -> tuple[int, float, int, int]:
    """Integrates `state` from t to t_end in place and fills `out`.

    Parameters
    ----------
    chain, laws, shaft
        The equations of motion.
    state
        Changed in place.
    t, t_end, h, longest
        Times, first and longest step [s].
    most
        After so many steps, rejected ones included, it gives up.
    tolerance
        (2,) error per step in rad and rad/s. A step whose Newton iteration fails, or whose error is
        larger, is repeated shorter.
    work
        Working memory.
    out
        Samples, whose times ascend and lie in (t, t_end].

    Returns
    -------
    tuple
        Status, last step length [s], accepted steps, rejected steps.

    Notes
    -----
    Third order in the step. Steps end on `shaft.landings`, where the acceleration jumps.
    """
    landing = accepted = rejected = 0
    # The compiler gives a literal a type of its own, and would compile each function that takes it
    # a second time.
    sample = int(0)  # noqa: RUF046, UP018
    jumped = True
    while t < t_end:
        if accepted + rejected >= most:
            return TOO_MANY_STEPS, h, accepted, rejected
        # The error estimate assumes smooth accelerations. After a jump the step begins short and
        # with fresh accelerations.
        while landing < shaft.landings.size and shaft.landings[landing] <= t:
            landing += 1
            h = min(h, FIRST_STEP_S)
            jumped = True
        if jumped and not start(chain, laws, shaft, state, t, work):
            return STEP_TOO_SHORT, h, accepted, rejected
        if landing < shaft.landings.size:
            stop = min(t_end, shaft.landings[landing])
        else:
            stop = t_end
        h = min(h, longest)
        # A remainder that is hardly longer than the step is taken at once; one below two steps is
        # halved, so that no tiny step is left.
        if stop - t <= 1.0000001 * h:
            t_new = stop
        else:
            t_new = t + min(h, 0.5 * (stop - t))
        error = try_step(chain, laws, shaft, state, t, t_new, tolerance, work)
        if error > 1.0:
            rejected += 1
            # The error estimate is of third order in the step; 0.9 is a margin.
            h = (t_new - t) * (0.5 if np.isinf(error) else max(0.2, 0.9 / np.cbrt(error)))
            if h < SHORTEST_STEP_S:
                return STEP_TOO_SHORT, h, accepted, rejected
            continue
        # An end that reverses its slip within the step would be given the wrong friction; the step
        # ends at the reversal instead.
        shorter = limit_step_to_reversal(chain, t_new - t, work)
        if shorter < GAIN_BY_TURN * (t_new - t):
            rejected += 1
            h = shorter
            continue
        sample, jumped = accept_step(chain, laws, state, t, t_new, sample, work, out)
        accepted += 1
        longer = (t_new - t) * min(3.0, 0.9 / np.cbrt(error))
        # A step that was cut short by a landing or the end is no reason to shorten h.
        h = max(h, longer) if t_new - t < h else longer
        t = t_new
    return DONE, h, accepted, rejected


integrate = jit(take_steps)


@jit
def integrate_lanes(
    chain: Chain,
    laws: Laws,
    shaft: Shaft,
    state: State,
    t: float,
    t_end: float,
    h: float,
    longest: float,
    most: int,
    tolerance: Floats,
    work: Work,
    out: Samples,
) -> tuple[int, float, int, int]:
    """As `integrate` for eight strokes side by side: arrays have a last axis of eight, and numbers
    of `chain` and `shaft` are (8,).

    A step is as short as the worst lane needs. Where one lane fails, all do.
    """
    moved = State(
        view_lanes(state.q),
        view_lanes(state.w),
        view_lanes(state.a),
        view_lanes(state.anchor),
        state.memory,
    )
    turned = Shaft(
        view_lanes(shaft.breaks),
        view_lanes(shaft.coefficient),
        shaft.landings,
        shaft.free,
        view_lanes(shaft.rotor),
        view_lanes(shaft.feed),
        view_lanes(shaft.k_angle),
        view_lanes(shaft.angle),
        view_lanes(shaft.k_speed),
        view_lanes(shaft.speed),
        view_lanes(shaft.gap),
        view_lanes(shaft.loss),
        view_lanes(shaft.limit),
        view_lanes(shaft.cogging),
        view_lanes(shaft.cycles),
        view_lanes(shaft.phase),
    )
    filled = Samples(
        out.t, view_lanes(out.q), view_lanes(out.w), view_lanes(out.force), view_lanes(out.contact)
    )
    return take_steps(
        view_fields(chain),
        laws,
        turned,
        moved,
        t,
        t_end,
        h,
        longest,
        most,
        tolerance,
        view_fields(work),
        filled,
    )
