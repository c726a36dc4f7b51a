"""Play before the spring of a joint engages: within half the gap to either side of its rest position the spring does nothing."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rfca_rig.model.compiled import jit

Floats = NDArray[np.float64]


class PlayArrays(NamedTuple):
    """Half the gap (n,) of each joint in rad or m, its rest position (n,), and coefficients (3, n) of x, x |x| and x^3 of its spring.

    The torque is that at `ahead_s` after a step's beginning: the mean over the step under Runge-Kutta; an implicit step takes its springs
    at its beginning.
    """

    half_gap: Floats
    rest: Floats
    spring: Floats
    ahead_s: float


@jit
def add_spring_play(arrays: PlayArrays, q: Floats, w: Floats, applied: Floats) -> None:
    """Adds torques to `applied` (n,) that turn MuJoCo's springs into springs with play; `q` and `w` are (n,)."""
    # MuJoCo computes the spring without play; its torque is cancelled, and that of the reduced deflection is applied instead.
    for i in range(arrays.half_gap.size):
        if arrays.half_gap[i] > 0.0:
            full = q[i] + arrays.ahead_s * w[i] - arrays.rest[i]
            engaged = np.sign(full) * max(abs(full) - arrays.half_gap[i], 0.0)
            one, two, three = arrays.spring[0, i], arrays.spring[1, i], arrays.spring[2, i]
            applied[i] += full * (one + abs(full) * two + full * full * three)
            applied[i] -= engaged * (one + abs(engaged) * two + engaged * engaged * three)
