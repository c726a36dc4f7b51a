"""Counters of faulty, saturated and frozen records of a force sensor."""

import numpy as np
from numpy.typing import NDArray

from rfca_rig.codecs.netbox_status import SATURATED, WARNINGS

# Bit 31, the summary error, is set for every error, so it does not identify saturation.
SATURATED_BIT = np.uint32(SATURATED & 0x7FFFFFFF)
MIN_FROZEN_RECORDS = 50


class StatusCounter:
    """Counts records with a bad status, and the saturated ones among them. All sensors use the status words of the Net F/T."""

    def __init__(self) -> None:
        self.faulty = self.saturated = 0
        self.seen = 0

    def take(self, status: NDArray[np.uint32]) -> None:
        """Counts one batch of status words (m,)."""
        if not status.any():
            return
        faulty = status[~np.isin(status, list(WARNINGS))]
        self.faulty += len(faulty)
        self.saturated += int((faulty & SATURATED_BIT != 0).sum())
        self.seen |= int(np.bitwise_or.reduce(faulty, initial=0))


class FrozenRecordCounter:
    """Counts records that only repeat the one before, for sensors that number records but not measurements.

    A working converter is never constant for long in all six axes, so 50 equal records in a row count as frozen.
    """

    def __init__(self) -> None:
        self.frozen = 0
        self._last: NDArray[np.generic] | None = None
        self._run = 0

    def take(self, values: NDArray[np.generic]) -> None:
        """Counts one batch (m, n) of raw values, one column per axis or gage."""
        if not len(values):
            return
        before = values[:1] if self._last is None else self._last
        same = (values == np.concatenate([before, values[:-1]])).all(axis=1)
        if self._last is None:
            same[0] = False
        self._last = values[-1:].copy()
        # The usual case, without the loop over all records.
        if not same.any() and not self._run:
            return
        for repeats in same.tolist():
            self._run = self._run + 1 if repeats else 0
            if self._run >= MIN_FROZEN_RECORDS:
                # The whole run counts once it has reached the limit, then each further record.
                self.frozen += MIN_FROZEN_RECORDS if self._run == MIN_FROZEN_RECORDS else 1
