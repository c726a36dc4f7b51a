"""Follows the equilibrium of the chain on the ground from one held shaft angle to the next. Symbols as in `state`."""

import numpy as np

from rfca_rig.model.anchors import store_ends
from rfca_rig.model.compiled import jit_allocating
from rfca_rig.model.contact import drag_anchors
from rfca_rig.model.forces import assemble
from rfca_rig.model.linear import solve
from rfca_rig.model.state import Chain, Floats, State, Work

NEWTON_LIMIT = 25
CONVERGED_RAD = 1e-11
STEP_RAD = np.radians(0.25)  # keeps Newton on the path; a fifth of it gives the same states to 1e-12 N
SHORTEST_STEP_RAD = np.radians(1e-4)
# Sum of the changes of one step. A link that turns by more has come to another equilibrium, which does not continue the path.
FARTHEST_TURN_RAD = 0.15


@jit_allocating
def balance(chain: Chain, state: State, q: Floats, angle: float, nothing: Floats, work: Work) -> bool:
    """Solves for the equilibrium with the shaft at `angle` and the anchors of `state`, by Newton from `q` (n,); True when found nearby.

    `nothing` (n,) are zeros: at rest the ground has neither damping nor drag. The first iteration goes along the tangent of the path,
    because row 0 requires the new shaft angle. A slipping end keeps |F| = mu N, which the derivative includes, so it is not symmetric.
    """
    turned = 0.0
    for _ in range(NEWTON_LIMIT):
        assemble(chain, None, state, 0.0, q, nothing, nothing, (0.0, 0.0, 1.0), work)
        # Row 0, the torque of the shaft, is replaced by the condition that the shaft has its angle.
        work.R[0] = q[0] - angle
        work.J[0, :] = 0.0
        work.J[0, 0] = 1.0
        if not solve(work.J, work.pivot, work.R):
            return False
        q -= work.R
        change = np.max(np.abs(work.R))
        turned += change
        # Written so that NaN ends the iteration, too.
        if not turned < FARTHEST_TURN_RAD:
            return False
        if change < CONVERGED_RAD:
            return True
    return False


@jit_allocating
def turn_shaft(chain: Chain, state: State, angle: float, nothing: Floats, work: Work) -> bool:
    """Turns the shaft to `angle` in small steps, and `state` with it; False where the path ends before. `nothing` (n,) are zeros.

    A step that finds no equilibrium nearby is repeated at half the length. After each step the anchors follow slipping ends, so that
    friction depends on the path.
    """
    q = state.q
    step, trial = STEP_RAD, q.copy()
    # An infinite limit: at the beginning the force of each tie follows from its stretch alone.
    work.limit[2] = np.inf
    assemble(chain, None, state, 0.0, q, nothing, nothing, None, work)
    work.ends[:], work.limit[2] = work.place, work.limit[0]
    while q[0] != angle:
        remaining = angle - q[0]
        goal = angle if abs(remaining) <= step else q[0] + np.sign(remaining) * step
        trial[:] = q
        if balance(chain, state, trial, goal, nothing, work):
            # Exactly the goal, so that the loop can end by equality.
            trial[0] = goal
            assemble(chain, None, state, 0.0, trial, nothing, nothing, None, work)
            drag_anchors(chain, state, trial, work)
            store_ends(chain, state, trial, work)
            work.limit[2] = work.limit[0]
            q[:] = trial
            step = min(2.0 * step, STEP_RAD)
        else:
            step *= 0.5
            if step < SHORTEST_STEP_RAD:
                return False
    return True
