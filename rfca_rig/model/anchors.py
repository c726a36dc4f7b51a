"""Where the ends are tied to the ground: what a step does to the anchors of friction. Symbols as in `state`.

Friction remembers how far an end has slipped, and within a step it knows only where the end was when the step began. An end that
turns back inside a step has been farther than where it ends, and one that touches down was tied where it touched. The step is
therefore cut short right behind a turn, and the anchors are put where the end has really been.
"""

import numpy as np

from rfca_rig.model.bump import SLOPE, Y
from rfca_rig.model.compiled import inlined
from rfca_rig.model.contact import extra_way, stretch_after, turn_to_floor
from rfca_rig.model.state import Chain, Floats, State, Work

MISSED_SHARE = 0.02  # of the presliding: how far an end may go back unnoticed; that share of mu N is wrong for the step
WITHIN_REACH = 1.0 - 1e-9


@inlined
def went_back(chain: Chain, h: float, k: int, work: Work) -> float:
    """How far end k, slipping where the step began, has come back from its farthest point where the step ends [m], else 0."""
    v0, v1 = float(work.ends[k, 3]), float(work.place[k, 3])
    if work.ends[k, 0] <= 0.0 or work.place[k, 0] <= 0.0 or v0 * v1 >= 0.0 or work.ends[k, 2] * v0 <= 0.0:
        return 0.0
    if abs(work.ends[k, 2]) < WITHIN_REACH * chain.presliding:
        return 0.0
    return 0.5 * h * v1 * v1 / abs(v0 - v1)


@inlined
def length_to_turn(chain: Chain, h: float, work: Work) -> float:
    """A shorter step that ends right behind the first place where an end turns back; h if none goes back farther than it may."""
    allowed, shorter = MISSED_SHARE * chain.presliding, h
    for k in range(work.place.shape[0]):
        if went_back(chain, h, k, work) > allowed:
            v0 = abs(work.ends[k, 3])
            braking = (v0 + abs(work.place[k, 3])) / h
            shorter = min(shorter, (v0 + np.sqrt(0.5 * braking * allowed)) / braking)
    return shorter


@inlined
def tie_anchors(chain: Chain, state: State, h: float, q: Floats, work: Work) -> bool:
    """After a step of length h, the ends located in `work`: ties each where it has been. True where that changes a friction force."""
    changed = False
    y = q[chain.length.size] * turn_to_floor(chain)[0] if q.size > chain.length.size else 0.0
    for k in range(chain.length.size):
        y += work.down[k]
        more = extra_way(chain, state, k, q, work)
        s = y - chain.lever * q[k] + more
        depth, rate, slip, limit = work.place[k, 0], work.place[k, 1], work.place[k, 3], work.limit[1, k]
        stretch, back = s - state.anchor[k], went_back(chain, h, k, work)
        if back > 0.0:
            there = back * np.sign(work.ends[k, 3])
            stretch = stretch_after(chain, k, stretch + there, limit, work) - there
            changed = True
        elif depth > 0.0 and work.ends[k, 0] <= 0.0:
            touched_s = min(depth / rate, h) if rate > 0.0 else h
            stretch = 0.5 * slip * touched_s  # the limit has grown from zero meanwhile
            changed = True
        else:
            stretch = stretch_after(chain, k, stretch, limit, work)
        reach = chain.presliding if depth > 0.0 else 0.0
        state.anchor[k] = s - min(max(stretch, -reach), reach) - more
    note_ends(chain, state, q, work)
    for k in range(chain.length.size):
        work.limit[2, k] = work.limit[1, k]
    return changed


@inlined
def note_ends(chain: Chain, state: State, q: Floats, work: Work) -> None:
    """Keeps what the located ends do where the next step begins, with their stretch from the anchors as they are now."""
    y = q[chain.length.size] * turn_to_floor(chain)[0] if q.size > chain.length.size else 0.0
    for k in range(chain.length.size):
        y += work.down[k]
        work.ends[k, 0], work.ends[k, 1], work.ends[k, 3] = work.place[k, 0], work.place[k, 1], work.place[k, 3]
        if chain.bump_height != 0.0:
            work.ends[k, Y], work.ends[k, SLOPE] = work.place[k, Y], work.place[k, SLOPE]
        work.ends[k, 2] = y - chain.lever * q[k] - state.anchor[k]
