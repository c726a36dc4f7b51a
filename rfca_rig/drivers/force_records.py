"""Checks of the records of a force sensor: lost, duplicate and late ones, and counters of faulty, saturated and frozen ones."""

import numpy as np
from numpy.typing import NDArray

from rfca_rig.codecs.force_sensors import SATURATED, WARNINGS

Ints = NDArray[np.int64]

# Number of missing records that are remembered, to recognise them if they come late.
MAX_MISSING_RECORDS = 100_000

# Bit 31, the summary error, is set for every error, so it does not identify saturation.
SATURATED_BIT = np.uint32(SATURATED & 0x7FFFFFFF)
MIN_FROZEN_RECORDS = 50


class RecordSequence:
    """Follows a 32 bit counter that starts at `first` and wraps.

    From each batch the records that continue the stream are picked, in the order of their numbers. A record older than those already
    handed out is never handed out: it is a duplicate, or it is late and stays lost. Differences are signed 32 bit differences, so that
    an old record does not look four billion records ahead.
    """

    def __init__(self, first: int = 1) -> None:
        self._next = first
        self._missing: set[int] = set()
        self.received = self.lost = self.duplicate = self.out_of_order = 0

    def take(self, numbers: NDArray[np.uint32]) -> tuple[Ints, Ints]:
        """Sorts out one batch.

        Parameters
        ----------
        numbers : ndarray, shape (m,)
            Record numbers, 32 bit, in order of arrival.

        Returns
        -------
        picked : ndarray, shape (k,)
            Indices of the records to keep.
        unwrapped : ndarray, shape (k,)
            Their numbers without wrap, ascending.
        """
        # The view as int32 makes records behind `_next` negative.
        ahead = (numbers - np.uint32(self._next & 0xFFFFFFFF)).view(np.int32).astype(np.int64)
        # Fast path for a batch without gap, the usual case at 7000 to 15 000 records/s.
        if len(ahead) and ahead[0] == 0 and ahead[-1] == len(ahead) - 1 and not np.count_nonzero(ahead[1:] - ahead[:-1] != 1):
            picked, fresh = np.arange(len(ahead)), ahead
        else:
            picked, fresh = self._sort_out(ahead)
        unwrapped = self._next + fresh
        self.received += len(fresh)
        self._next += int(fresh[-1]) + 1 if len(fresh) else 0
        return picked, unwrapped

    def _sort_out(self, ahead: Ints) -> tuple[Ints, Ints]:
        for old in ahead[ahead < 0]:
            number = self._next + int(old)
            if number in self._missing:
                self._missing.remove(number)
                self.out_of_order += 1
            else:
                self.duplicate += 1
        new = np.flatnonzero(ahead >= 0)
        fresh, first = np.unique(ahead[new], return_index=True)
        self.duplicate += len(new) - len(fresh)
        # Counts records that a higher number overtook within the batch.
        order = ahead[new][np.sort(first)]
        self.out_of_order += int((order < np.maximum.accumulate(order)).sum()) if len(order) else 0
        self._count_gaps(fresh)
        return new[first], fresh

    def _count_gaps(self, fresh: Ints) -> None:
        if len(fresh) == 0:
            return
        lost = int(fresh[-1]) + 1 - len(fresh)
        self.lost += lost
        if len(self._missing) + lost > MAX_MISSING_RECORDS:
            # After such a gap late records are not worth the memory; they then count as duplicates.
            self._missing.clear()
        if 0 < lost <= MAX_MISSING_RECORDS:
            gaps = np.setdiff1d(np.arange(int(fresh[-1])), fresh, assume_unique=True)
            self._missing.update((self._next + gaps).tolist())


class StatusCounter:
    """Counts records with a bad status, and the saturated ones among them. All sensors use the status words of the Net F/T."""

    def __init__(self) -> None:
        self.faulty = self.saturated = 0
        self.seen = 0

    def take(self, status: NDArray[np.uint32]) -> None:
        """Counts one batch of status words (m,)."""
        if not np.count_nonzero(status):
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
