"""Detects that the leg is at rest: force and angle stay within bands, over a stated time, as means of 50 ms."""

from collections import deque
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rfca_rig.engine.loop import Loop
from rfca_rig.protocol.plan import SettleCriterion

PERIOD_S = 0.01
# Averages 350 records at 7 kHz: sensor noise of 0.15 N becomes 0.01 N. Still short enough to see a leg that swings.
MEAN_S = 0.05


@dataclass(frozen=True)
class Settled:
    """Result: `reached` is False where the time limit came first; `wrench` (6,) is the last mean of force [N] and moment [N m]."""

    reached: bool
    wrench: NDArray[np.float64]


def settle(loop: Loop, target_rad: float, criterion: SettleCriterion) -> Settled:
    """Holds the shaft at `target_rad` until force and angle stay within the bands of the criterion, or its time limit is reached.

    Returns
    -------
    Settled
        Whether the criterion was met, and the mean wrench (6,) in N and N m.
    """
    per_mean = round(MEAN_S / PERIOD_S)
    # At least two means: the range of a single one is zero and would always be within the band.
    means: deque[np.ndarray] = deque(maxlen=max(2, round(criterion.for_s / MEAN_S)))
    began_s = loop.now_s
    # Half a mean is allowed for, because the loop's times do not add up to exact multiples of MEAN_S.
    while loop.now_s - began_s < criterion.limit_s - 0.5 * MEAN_S:
        ticks = []
        for _ in range(per_mean):
            loop.step_to_angle(target_rad, 0.0, PERIOD_S)
            ticks.append([loop.angle_rad, *loop.wrench])
        means.append(np.mean(ticks, axis=0))
        if len(means) == means.maxlen and _inside(np.ptp(means, axis=0), criterion):
            return Settled(True, np.mean(means, axis=0)[1:])
    return Settled(False, np.mean(means, axis=0)[1:])


def _inside(band: np.ndarray, criterion: SettleCriterion) -> bool:
    # Column 0 is the angle, columns 1 to 3 the force; the criterion has no band for moments.
    return bool(band[0] <= criterion.angle_band_rad and band[1:4].max() <= criterion.force_band_N)
