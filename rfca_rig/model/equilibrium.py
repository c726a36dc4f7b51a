"""Finds the rest pose of the chain with its shaft held or on a spring. Symbols as in `state`."""

import numpy as np

from rfca_rig.model.compiled import jit_allocating
from rfca_rig.model.contact import drag_anchors
from rfca_rig.model.forces import assemble
from rfca_rig.model.integrator import update_memory
from rfca_rig.model.linear import solve
from rfca_rig.model.shaft import drive_torque
from rfca_rig.model.state import Chain, Laws, Shaft, State, Work

NEWTON_LIMIT = 200
# Time since the last step that laws with memory are given: at rest everything has relaxed.
LONG_S = 1e9
LONGEST_TURN_RAD = 0.1  # per iteration, so that a leg far from rest does not jump through the ground


@jit_allocating
def find_equilibrium(chain: Chain, laws: Laws | None, shaft: Shaft, state: State, tolerance: float, work: Work) -> bool:
    """Changes state.q to the equilibrium with the shaft held at q[0], or free on its spring, by damped Newton; True when found.

    `chain` must be without friction: the force of a stuck end depends on its path, which a rest pose does not contain.
    `tolerance` is the largest change of the last iteration [rad].
    """
    q, zero = state.q, np.zeros(state.q.size)
    for _ in range(NEWTON_LIMIT):
        assemble(chain, laws, state, LONG_S, q, zero, zero, (0.0, 0.0, 1.0), work)
        if shaft.free:
            torque, k_angle, _ = drive_torque(shaft, shaft.angle - q[0], 0.0, q[0])
            work.R[0] -= torque
            work.J[0, 0] += k_angle
        else:
            work.R[0] = 0.0
            work.J[0, :] = 0.0
            work.J[0, 0] = 1.0
        if not solve(work.J, work.pivot, work.R):
            return False
        # All coordinates are scaled alike, which keeps Newton's direction.
        change = np.max(np.abs(work.R))
        q -= work.R * min(1.0, LONGEST_TURN_RAD / max(change, 1e-300))
        if change < tolerance:
            return True
    return False


@jit_allocating
def reset_memory(chain: Chain, laws: Laws | None, state: State, work: Work) -> None:
    """Initialises the memory of the laws with the rest pose, and the anchors right below the ends."""
    assemble(chain, laws, state, LONG_S, state.q, state.w, state.a, None, work)
    # A loop: an assignment of whole arrays makes the compiler include the texts of its errors, which takes some seconds.
    for i in range(state.q.size):
        work.q[i] = state.q[i]
    update_memory(chain, laws, state, LONG_S, work)
    # With all depths at zero, `drag_anchors` takes every end for one in the air and puts its anchor below it.
    for k in range(work.place.shape[0]):
        for j in range(work.place.shape[1]):
            work.place[k, j] = 0.0
    drag_anchors(chain, state, state.q, work)
