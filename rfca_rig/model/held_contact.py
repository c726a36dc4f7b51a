"""Equilibrium of the chain on the ground while its shaft is held, followed from one shaft angle to the next. Symbols as in `state`."""

import numpy as np

from rfca_rig.model.anchors import note_ends
from rfca_rig.model.compiled import compiled_allocating
from rfca_rig.model.contact import drag_anchors
from rfca_rig.model.forces import assemble
from rfca_rig.model.linear import solve
from rfca_rig.model.state import Chain, Floats, State, Work

NEWTON_LIMIT = 25
CONVERGED_RAD = 1e-11
STEP_RAD = np.radians(0.25)  # keeps Newton on the path; a fifth of it gives the same states to 1e-12 N
SHORTEST_STEP_RAD = np.radians(1e-4)
FARTHEST_TURN_RAD = 0.15  # of a link within one step: more is no continuation of the path but another equilibrium


@compiled_allocating
def balance(chain: Chain, state: State, q: Floats, angle: float, nothing: Floats, work: Work) -> bool:
    """Newton from q to the equilibrium with the shaft at `angle` and the anchors of `state`; True when found nearby.

    At w = 0 the ground has neither damping nor drag. The first iteration goes along the tangent of the path, because row 0
    asks for the new shaft angle. A slipping end keeps |F| = mu N, which the tangent knows, so that the rows are not symmetric.
    """
    turned = 0.0
    for _ in range(NEWTON_LIMIT):
        assemble(chain, None, state, 0.0, q, nothing, nothing, (0.0, 0.0, 1.0), work)
        work.R[0] = q[0] - angle
        work.J[0, :] = 0.0
        work.J[0, 0] = 1.0
        if not solve(work.J, work.pivot, work.R):
            return False
        q -= work.R
        change = np.max(np.abs(work.R))
        turned += change
        if not turned < FARTHEST_TURN_RAD:
            return False
        if change < CONVERGED_RAD:
            return True
    return False


@compiled_allocating
def turn_shaft(chain: Chain, state: State, angle: float, nothing: Floats, work: Work) -> bool:
    """Turns the shaft to `angle` in small steps, `state` following; False where the path ends before it.

    A step that finds no equilibrium nearby is repeated at half the length. After each the anchors of slipping ends are dragged
    along: that is the memory of where an end stuck.
    """
    q = state.q
    step, tried = STEP_RAD, q.copy()
    work.limit[2] = np.inf
    assemble(chain, None, state, 0.0, q, nothing, nothing, None, work)
    work.ends[:], work.limit[2] = work.place, work.limit[0]
    while q[0] != angle:
        left = angle - q[0]
        goal = angle if abs(left) <= step else q[0] + np.sign(left) * step
        tried[:] = q
        if balance(chain, state, tried, goal, nothing, work):
            tried[0] = goal
            assemble(chain, None, state, 0.0, tried, nothing, nothing, None, work)
            drag_anchors(chain, state, tried, work)
            note_ends(chain, state, tried, work)
            work.limit[2] = work.limit[0]
            q[:] = tried
            step = min(2.0 * step, STEP_RAD)
        else:
            step *= 0.5
            if step < SHORTEST_STEP_RAD:
                return False
    return True
