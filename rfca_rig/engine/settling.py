"""When is the leg at rest: bands on force and angle, over a stated time, of means short enough to see it move."""

from collections import deque
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rfca_rig.engine.loop import Loop
from rfca_rig.protocol.plan import SettleCriterion

PERIOD_S = 0.01
MEAN_S = 0.05  # averages 350 records at 7 kHz: sensor noise of 0.15 N becomes 0.01 N


@dataclass(frozen=True)
class Settled:
    """`reached` is False where the criterion's time limit came first; `wrench` (6,) is the last mean of force [N] and moment [N m]."""

    reached: bool
    wrench: NDArray[np.float64]


def settle(loop: Loop, target_rad: float, criterion: SettleCriterion) -> Settled:
    """Holds the shaft until the criterion is met."""
    per_mean = round(MEAN_S / PERIOD_S)
    means: deque[np.ndarray] = deque(maxlen=max(2, round(criterion.for_s / MEAN_S)))
    began_s = loop.now_s
    while loop.now_s - began_s < criterion.limit_s - 0.5 * MEAN_S:
        ticks = []
        for _ in range(per_mean):
            loop.to_angle(target_rad, 0.0, PERIOD_S)
            ticks.append([loop.angle_rad, *loop.wrench])
        means.append(np.mean(ticks, axis=0))
        if len(means) == means.maxlen and _inside(np.ptp(means, axis=0), criterion):
            return Settled(True, np.mean(means, axis=0)[1:])
    return Settled(False, np.mean(means, axis=0)[1:])


def _inside(band: np.ndarray, criterion: SettleCriterion) -> bool:
    return bool(band[0] <= criterion.angle_band_rad and band[1:4].max() <= criterion.force_band_N)
