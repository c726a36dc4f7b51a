"""The static equilibrium of the chain with its shaft held. Symbols as in `state`."""

import numpy as np

from rfca_rig.model.compiled import compiled
from rfca_rig.model.forces import assemble
from rfca_rig.model.integrator import room_to_work
from rfca_rig.model.linear import solve
from rfca_rig.model.state import Chain, Floats

NEWTON_LIMIT = 200
LONGEST_TURN_RAD = 0.1  # per iteration, so that a leg far from rest does not jump through the ground


@compiled
def settle(chain: Chain, q: Floats, tolerance: float) -> bool:
    """Turns q (n,) into the equilibrium with the shaft held at q[0], by damped Newton; True when found.

    `chain` is to be without friction: what a stuck end carries depends on how it got there, which a rest pose does not know.
    """
    n = q.size
    work, zero = room_to_work(n), np.zeros(n)
    for _ in range(NEWTON_LIMIT):
        assemble(chain, q, zero, zero, zero, 0.0, 0.0, 1.0, work)
        work.R[0] = 0.0
        work.J[0, :] = 0.0
        work.J[0, 0] = 1.0
        if not solve(work.J, work.R):
            return False
        change = np.max(np.abs(work.R))
        q -= work.R * min(1.0, LONGEST_TURN_RAD / max(change, 1e-300))
        if change < tolerance:
            return True
    return False
