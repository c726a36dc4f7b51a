"""What the status words and the values of a force sensor's records say of them."""

import numpy as np
from numpy.typing import NDArray

from rfca_rig.codecs.netbox_status import SATURATED, WARNINGS

SATURATED_BIT = np.uint32(SATURATED & 0x7FFFFFFF)
FROZEN_RUN = 50


class StatusCount:
    """Records with a bad status, and those of them that are saturated. Words are those of the Net F/T, for every sensor."""

    def __init__(self) -> None:
        self.faulty = self.saturated = 0
        self.seen = 0

    def take(self, status: NDArray[np.uint32]) -> None:
        """Counts one batch."""
        if not status.any():
            return
        faulty = status[~np.isin(status, list(WARNINGS))]
        self.faulty += len(faulty)
        self.saturated += int((faulty & SATURATED_BIT != 0).sum())
        self.seen |= int(np.bitwise_or.reduce(faulty, initial=0))


class FrozenCount:
    """Records that only repeat the one before, for sensors that number their records but not their measurements.

    A live converter is never still for long in all six axes, so 50 equal records in a row are believed to be frozen.
    """

    def __init__(self) -> None:
        self.frozen = 0
        self._last: NDArray[np.generic] | None = None
        self._run = 0

    def take(self, values: NDArray[np.generic]) -> None:
        """Counts one batch (m, 6) of raw values."""
        if not len(values):
            return
        before = values[:1] if self._last is None else self._last
        same = (values == np.concatenate([before, values[:-1]])).all(axis=1)
        if self._last is None:
            same[0] = False
        self._last = values[-1:].copy()
        if not same.any() and not self._run:
            return
        for repeats in same.tolist():
            self._run = self._run + 1 if repeats else 0
            if self._run >= FROZEN_RUN:
                self.frozen += FROZEN_RUN if self._run == FROZEN_RUN else 1
