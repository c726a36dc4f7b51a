"""Prescribed joints: they follow a recorded or commanded trajectory, whatever the load, and are not
simulated.

Such a joint gets an armature beside which every load is negligible, and a force that accelerates it
along the trajectory. At the beginning of each step its state is set to the trajectory, so that no
error accumulates.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicHermiteSpline, CubicSpline, PPoly, make_lsq_spline

from rfca_rig.model.kernel.compiled import jit_internal

Floats = NDArray[np.float64]
Places = NDArray[np.intp]

ARMATURE = 1e9  # kg m2 or kg: 100 N m change its speed by 1e-7 rad/s in a second


@dataclass(frozen=True)
class PrescribedMotion:
    """Trajectories of p joints as one piecewise cubic (scipy's PPoly) of the time since the
    start, with values (..., p).
    """

    cubic: Any

    def since(self, start_s: float) -> "PrescribedMotion":
        """The same trajectories, with times counted from `start_s`."""
        return PrescribedMotion(PPoly(self.cubic.c, self.cubic.x - start_s))

    def sample(self, t_s: Floats) -> tuple[Floats, Floats]:
        """Positions and speeds (k, p) at times (k,); before the first and after the last time
        they continue at constant speed.
        """
        inside = np.clip(t_s, self.cubic.x[0], self.cubic.x[-1])
        speed = np.asarray(self.cubic(inside, 1))
        return np.asarray(self.cubic(inside) + (t_s - inside)[:, None] * speed), speed


def fit_trajectory(t_s: Floats, position: Floats, smoothed_s: Sequence[float]) -> PrescribedMotion:
    """The trajectories of p joints by the least-squares cubic spline through their readings.

    Parameters
    ----------
    t_s
        (m,) ascending.
    position
        (m, p) in rad or m.
    smoothed_s
        (p,) distance of the knots; 0 for the spline through every reading.
    """
    if position.shape[1] == 0:
        return PrescribedMotion(PPoly(np.zeros((4, 1, 0)), np.array([t_s[0], t_s[-1]])))
    breaks = t_s
    pieces = []
    for column, apart_s in zip(position.T, smoothed_s, strict=True):
        if apart_s > 0.0:
            inner = np.linspace(t_s[0], t_s[-1], max(int((t_s[-1] - t_s[0]) / apart_s), 1) + 1)[
                1:-1
            ]
            knots = np.concatenate([np.full(4, t_s[0]), inner, np.full(4, t_s[-1])])
            fitted = make_lsq_spline(t_s, column, knots, k=3)
            column = fitted(t_s)  # noqa: PLW2901  (its readings without their noise)
            # A Hermite spline on the same breaks as the others, so that all joints fit in one
            # piecewise polynomial.
            slope = fitted.derivative()(t_s)
            pieces.append(CubicHermiteSpline(t_s, column, slope).c)
        else:
            pieces.append(CubicSpline(t_s, column).c)
    return PrescribedMotion(PPoly(np.stack(pieces, axis=2), breaks))


class PrescribedArrays(NamedTuple):
    """Arrays for the compiled loop: the joints' indices (p,), and positions and speeds (k + 1,
    p) at the ends of the steps.
    """

    joints: Places
    position: Floats
    speed: Floats


@jit_internal
def prescribe(
    arrays: PrescribedArrays, k: int, h: float, q: Floats, w: Floats, applied: Floats
) -> None:
    """Sets the prescribed joints in `q`, `w` (n,) to the beginning of step k, and writes the
    force to its end into `applied` (n,).
    """
    # After the last step there is no next speed, and no force is needed.
    for i in range(arrays.joints.size):
        joint = arrays.joints[i]
        q[joint] = arrays.position[k, i]
        w[joint] = arrays.speed[k, i]
        if k + 1 < arrays.speed.shape[0]:
            applied[joint] = ARMATURE * (arrays.speed[k + 1, i] - arrays.speed[k, i]) / h
