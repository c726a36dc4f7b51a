"""Joints whose motion is given: they follow a recorded or commanded trajectory, whatever the load, and are not simulated.

Such a joint gets an armature beside which every load is nothing, and a force that accelerates it as the trajectory does. At the beginning
of each step its state is set to the trajectory, so that nothing accumulates.
"""

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rfca_rig.model.compiled import compiled

Floats = NDArray[np.float64]
Places = NDArray[np.intp]

ARMATURE = 1e9  # kg m2 or kg: 100 N m change its speed by 1e-7 rad/s in a second


@dataclass(frozen=True)
class PrescribedMotion:
    """Trajectories of p joints as one piecewise cubic (scipy's PPoly) of the time since the start, with values (..., p)."""

    cubic: Any

    def sample(self, t_s: Floats) -> tuple[Floats, Floats]:
        """Positions and speeds (k, p) at times (k,); before its first and after its last time it stands still."""
        first, last = self.cubic.x[0], self.cubic.x[-1]
        inside = np.clip(t_s, first, last)
        speed = np.where(((t_s < first) | (t_s > last))[:, None], 0.0, self.cubic(inside, 1))
        return np.asarray(self.cubic(inside)), np.asarray(speed)


class PrescribedArrays(NamedTuple):
    """What the compiled loop needs: the joints' places (p,), and positions and speeds (k + 1, p) at the ends of the steps."""

    joints: Places
    position: Floats
    speed: Floats


@compiled
def prescribe(arrays: PrescribedArrays, k: int, h: float, q: Floats, w: Floats, applied: Floats) -> None:
    """Sets the joints to the beginning of step k, and applies what carries them to its end."""
    for i in range(arrays.joints.size):
        joint = arrays.joints[i]
        q[joint], w[joint] = arrays.position[k, i], arrays.speed[k, i]
        if k + 1 < arrays.speed.shape[0]:
            applied[joint] = ARMATURE * (arrays.speed[k + 1, i] - arrays.speed[k, i]) / h
