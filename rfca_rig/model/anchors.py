"""Updates the anchors of friction, by which the ends are tied to the ground, after a step. Symbols as in `state`.

Friction depends on how far an end has slipped, and within a step only the position at its beginning is known. An end that reverses its
slip inside a step has been farther than where it ends, and one that touches down was tied where it touched. The step is
therefore cut short just after a reversal, and the anchors follow from the path of the end.
"""

import numpy as np

from rfca_rig.model.bump import SLOPE, Y
from rfca_rig.model.compiled import jit_inline
from rfca_rig.model.contact import correct_path, project_frame_on_floor, stretch_after
from rfca_rig.model.state import Chain, Floats, State, Work

# Share of the presliding by which an end may move back unnoticed. In that step, friction errs by this share of mu N.
MISSED_SHARE = 0.02
WITHIN_REACH = 1.0 - 1e-9  # a stretch at the presliding, but for rounding


@jit_inline
def measure_slip_reversal(chain: Chain, h: float, k: int, work: Work) -> float:
    """Distance [m] from the farthest point of end k to its place at the step's end, if it slipped first and then reversed; else 0."""
    # It must touch at both ends of the step, reverse its speed, and have slipped along its speed, at its full stretch, at the beginning.
    v0, v1 = float(work.ends[k, 3]), float(work.place[k, 3])
    if work.ends[k, 0] <= 0.0 or work.place[k, 0] <= 0.0 or v0 * v1 >= 0.0 or work.ends[k, 2] * v0 <= 0.0:
        return 0.0
    if abs(work.ends[k, 2]) < WITHIN_REACH * chain.presliding:
        return 0.0
    # The speed changes linearly from v0 to v1, so the last part of the step after the reversal takes h |v1| / |v0 - v1|.
    return 0.5 * h * v1 * v1 / abs(v0 - v1)


@jit_inline
def limit_step_to_reversal(chain: Chain, h: float, work: Work) -> float:
    """Length [s] of a step that ends just after the first reversal of an end; h if none moves back farther than allowed."""
    allowed, shorter = MISSED_SHARE * chain.presliding, h
    for k in range(work.place.shape[0]):
        if measure_slip_reversal(chain, h, k, work) > allowed:
            # With constant deceleration the end stands after v0 / braking; from there it moves back by a quarter of what is allowed.
            v0 = abs(work.ends[k, 3])
            braking = (v0 + abs(work.place[k, 3])) / h
            shorter = min(shorter, (v0 + np.sqrt(0.5 * braking * allowed)) / braking)
    return shorter


@jit_inline
def update_friction_anchors(chain: Chain, state: State, h: float, q: Floats, work: Work) -> bool:
    """Updates the anchors (n,) after a step of length h [s] to `q` (c,), the ends located in `work`.

    True where an end reversed or touched down: a friction force has changed, and the accelerations must be computed again.
    """
    changed = False
    y = q[chain.length.size] * project_frame_on_floor(chain)[0] if q.size > chain.length.size else 0.0
    for k in range(chain.length.size):
        y += work.down[k]
        more = correct_path(chain, state, k, q, work)
        s = y - chain.lever * q[k] + more
        depth, rate, slip, limit = work.place[k, 0], work.place[k, 1], work.place[k, 3], work.limit[1, k]
        stretch, back = s - state.anchor[k], measure_slip_reversal(chain, h, k, work)
        if back > 0.0:
            # Slip to the farthest point first, which drags the anchor along; then the tie relaxes by the way back.
            there = back * np.sign(work.ends[k, 3])
            stretch = stretch_after(chain, k, stretch + there, limit, work) - there
            changed = True
        elif depth > 0.0 and work.ends[k, 0] <= 0.0:
            # Time since touchdown. The limit has grown from zero since then, which halves the force of the stretch.
            touched_s = min(depth / rate, h) if rate > 0.0 else h
            stretch = 0.5 * slip * touched_s
            changed = True
        else:
            stretch = stretch_after(chain, k, stretch, limit, work)
        reach = chain.presliding if depth > 0.0 else 0.0
        state.anchor[k] = s - min(max(stretch, -reach), reach) - more
    store_ends(chain, state, q, work)
    for k in range(chain.length.size):
        work.limit[2, k] = work.limit[1, k]
    return changed


@jit_inline
def store_ends(chain: Chain, state: State, q: Floats, work: Work) -> None:
    """Stores the motion of the located ends in `work.ends` (n, 7), for the next step, with the stretch from the new anchors; `q` (c,)."""
    y = q[chain.length.size] * project_frame_on_floor(chain)[0] if q.size > chain.length.size else 0.0
    for k in range(chain.length.size):
        y += work.down[k]
        work.ends[k, 0], work.ends[k, 1], work.ends[k, 3] = work.place[k, 0], work.place[k, 1], work.place[k, 3]
        if chain.bump_height != 0.0:
            work.ends[k, Y], work.ends[k, SLOPE] = work.place[k, Y], work.place[k, SLOPE]
        work.ends[k, 2] = y - chain.lever * q[k] - state.anchor[k]
