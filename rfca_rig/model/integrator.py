"""The error-controlled implicit step that carries the chain through a stroke. Symbols as in `state`.

Kvaerno's ESDIRK 3/2 with four stages, the first explicit: third order, L-stable and stiffly accurate, so the accelerations (and
with them the forces) at the end of a step satisfy the equations of motion exactly. Its third stage is a solution of second order
at the end of the step, L-stable too; the difference is the error. A. Kvaerno, Singly diagonally implicit Runge-Kutta methods with
an explicit first stage, BIT 44 (2004).
"""

import numpy as np

from rfca_rig.model.anchors import length_to_turn, note_ends, tie_anchors
from rfca_rig.model.compiled import compiled, inlined
from rfca_rig.model.contact import locate_ends
from rfca_rig.model.forces import begin, call_hinge
from rfca_rig.model.samples import fill_samples
from rfca_rig.model.shaft import shaft_at
from rfca_rig.model.stage import solve_stage
from rfca_rig.model.state import Chain, Floats, Laws, Samples, Shaft, State, Work

G = 0.43586652150845967
STAGES = 4
TABLEAU = np.array(
    [
        [0.0, 0.0, 0.0],
        [G, 0.0, 0.0],
        [(-4.0 * G * G + 6.0 * G - 1.0) / (4.0 * G), (1.0 - 2.0 * G) / (4.0 * G), 0.0],
        [(6.0 * G - 1.0) / (12.0 * G), -1.0 / ((24.0 * G - 12.0) * G), (-6.0 * G * G + 6.0 * G - 1.0) / (6.0 * G - 3.0)],
    ]
)
NODES = np.array([0.0, 2.0 * G, 1.0, 1.0])
NEWTON_SHARE = 2e-3  # of the speed tolerance: forces between the ends of a step hang on the speeds there
PER_METRE = 100.0  # a frame's micrometre counts as much as a link's 0.1 mrad does at 10 mm
SHORTEST_STEP_S = 1e-10
FIRST_STEP_S = 1e-4
GAIN_BY_TURN = 0.98  # a step is not repeated for less
JUST_AFTER_S = 1e-12  # a shaft that jumps is asked for its motion after the jump

DONE, STEP_TOO_SHORT, TOO_MANY_STEPS = 0, 1, 2


@inlined
def start(chain: Chain, laws: Laws | None, shaft: Shaft, state: State, t: float, work: Work) -> bool:
    """Accelerations that go with the angles and speeds of `state`, where the last step's do not hold any more."""
    for i in range(state.q.size):
        work.base_q[i], work.base_w[i], work.a[i], work.jerk[i] = state.q[i], state.w[i], state.a[i], 0.0
    for k in range(state.anchor.size):
        work.limit[2, k] = np.inf  # each tie carries what its stretch says
    if not solve_stage(chain, laws, shaft, state, 0.0, t + JUST_AFTER_S, 0.0, 1.0, bool(0), work):
        return False
    for i in range(state.q.size):
        state.a[i] = work.a[i]
    if not shaft.free:
        _, state.w[0], state.a[0] = shaft_at(shaft, t + JUST_AFTER_S)
    locate_ends(chain, state, state.q, state.w, work)
    note_ends(chain, state, state.q, work)
    for k in range(state.anchor.size):
        work.limit[2, k] = work.limit[0, k]
    return True


@inlined
def predict(state: State, stage: int, h: float, work: Work) -> None:
    """First guess of a stage's acceleration: along the last step's jerk, then along the stages there are."""
    a = work.stage_a
    for i in range(state.q.size):
        if stage == 1:
            work.a[i] = a[0, i] + NODES[1] * h * work.jerk[i]
        elif stage == 2:
            work.a[i] = a[1, i] + (a[1, i] - a[0, i]) * (1.0 - NODES[1]) / NODES[1]
        else:
            work.a[i] = a[2, i]


@inlined
def prepare(state: State, stage: int, h: float, work: Work) -> None:
    """Where a stage begins: what the stages before it add up to."""
    for i in range(state.q.size):
        q, w = state.q[i], state.w[i]
        for j in range(stage):
            q += h * TABLEAU[stage, j] * work.stage_w[j, i]
            w += h * TABLEAU[stage, j] * work.stage_a[j, i]
        work.base_q[i], work.base_w[i] = q, w


@inlined
def note_stage(stage: int, q: Floats, w: Floats, a: Floats, work: Work) -> None:
    """Keeps what a stage has found."""
    for i in range(q.size):
        work.stage_q[stage, i], work.stage_w[stage, i], work.stage_a[stage, i] = q[i], w[i], a[i]


@inlined
def try_step(chain: Chain, laws: Laws | None, shaft: Shaft, state: State, t: float, t_new: float, tolerance: Floats, work: Work) -> float:
    """A whole step into the stages of `work`. Returns its error in units of the tolerance, or infinity where a stage did not converge."""
    h = t_new - t
    note_stage(0, state.q, state.w, state.a, work)
    for stage in range(1, STAGES):
        predict(state, stage, h, work)
        prepare(state, stage, h, work)
        elapsed = NODES[stage] * h
        at = t_new if stage > 1 else t + elapsed
        if not solve_stage(chain, laws, shaft, state, elapsed, at, G * h, NEWTON_SHARE * tolerance[1], stage > 1, work):
            return np.inf
        note_stage(stage, work.q, work.w, work.a, work)
    error = 1e-12
    for i in range(state.q.size):
        weight = 1.0 if i < state.anchor.size else PER_METRE
        angle, speed = abs(work.stage_q[3, i] - work.stage_q[2, i]), abs(work.stage_w[3, i] - work.stage_w[2, i])
        error = max(error, weight * angle / tolerance[0], weight * speed / tolerance[1])
    return error


@compiled
def remember(chain: Chain, laws: Laws | None, state: State, h: float, work: Work) -> None:
    """Lets the hinge laws with memory take in the step of length h that ends in `work`."""
    if laws is None:
        return
    for m in range(laws.place.size):
        if laws.advance[m] != 0:
            for i in range(1, chain.length.size):
                if laws.only[m] in (-1, i):
                    call_hinge(chain, laws, laws.advance[m], m, i, state, h, work.q, work.w, work.a, work)


@inlined
def accept(chain: Chain, laws: Laws | None, state: State, t: float, t_new: float, first: int, work: Work, out: Samples) -> tuple[int, bool]:
    """Takes over the step in `work`: samples, anchors, memory, state. Returns the next sample's index, and whether forces jumped."""
    for k in range(state.anchor.size):
        work.limit[1, k] = work.limit[0, k]
    first = fill_samples(chain, laws, state, t, t_new, first, work, out)
    h, q, w, a, old_w, old_a = t_new - t, work.q, work.w, work.a, state.w, state.a
    for i in range(q.size):
        q[i], w[i], a[i] = work.stage_q[3, i], work.stage_w[3, i], work.stage_a[3, i]
        work.jerk[i] = (6.0 * (old_w[i] - w[i]) / h + 2.0 * old_a[i] + 4.0 * a[i]) / h
    begin(chain, q, work)
    locate_ends(chain, state, q, w, work)
    jumped = tie_anchors(chain, state, h, q, work)
    remember(chain, laws, state, h, work)
    for i in range(q.size):
        state.q[i], state.w[i], state.a[i] = q[i], w[i], a[i]
    return first, jumped


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
    most: int,
    tolerance: Floats,
    work: Work,
    out: Samples,
) -> tuple[int, float, int, int]:
    """Carries `state` from t to t_end in place and fills `out` (times ascending, in (t, t_end]).

    `tolerance` = (rad, rad/s) per step. A step whose Newton iteration fails, or whose error is too large, is repeated shorter:
    nothing is accepted unconverged. Steps end on `shaft.landings`, where the acceleration jumps. After `most` steps, those rejected
    too, it gives up. Returns (status, last step length, accepted steps, rejected steps).
    """
    landing = accepted = rejected = 0
    # to the compiler a literal is a type of its own: it would make a second copy of what takes it
    sample = int(0)  # noqa: RUF046, UP018
    jumped = True
    while t < t_end:
        if accepted + rejected >= most:
            return TOO_MANY_STEPS, h, accepted, rejected
        while landing < shaft.landings.size and shaft.landings[landing] <= t:
            landing += 1
            h = min(h, FIRST_STEP_S)
            jumped = True
        if jumped and not start(chain, laws, shaft, state, t, work):
            return STEP_TOO_SHORT, h, accepted, rejected
        stop = min(t_end, shaft.landings[landing]) if landing < shaft.landings.size else t_end
        h = min(h, longest)
        t_new = stop if stop - t <= 1.0000001 * h else t + min(h, 0.5 * (stop - t))
        error = try_step(chain, laws, shaft, state, t, t_new, tolerance, work)
        if error > 1.0:
            rejected += 1
            h = (t_new - t) * (0.5 if np.isinf(error) else max(0.2, 0.9 / np.cbrt(error)))
            if h < SHORTEST_STEP_S:
                return STEP_TOO_SHORT, h, accepted, rejected
            continue
        shorter = length_to_turn(chain, t_new - t, work)
        if shorter < GAIN_BY_TURN * (t_new - t):
            rejected += 1
            h = shorter
            continue
        sample, jumped = accept(chain, laws, state, t, t_new, sample, work, out)
        accepted += 1
        longer = (t_new - t) * min(3.0, 0.9 / np.cbrt(error))
        h = max(h, longer) if t_new - t < h else longer  # a step cut short by a landing says nothing against h
        t = t_new
    return DONE, h, accepted, rejected
