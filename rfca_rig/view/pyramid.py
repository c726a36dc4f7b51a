"""Least and greatest of all that a run has brought, at every width that somebody may look at, in memory that does not grow.

Level 0 has buckets of half a millisecond, every level above buckets twice as wide. Of each the newest are remembered: seconds of the
finest, days of the coarsest.
"""

from math import floor

import numpy as np

from rfca_rig.view.decimation import Extrema, Floats, gathered

BASE_S = 5e-4
LEVELS = 24
CAPACITY = 4096  # buckets of a level
AHEAD = CAPACITY // 2  # of level 0 are open at most
ACROSS = 1000  # buckets that a window is shown in


class Pyramid:
    """Takes samples in any order and chunks; a bucket that is closed does not change any more.

    Bucket n of level k begins at n * 2**k * BASE_S. A sample that comes too late for its bucket counts in the first one that is open: no
    peak is lost.
    """

    def __init__(self, channels: int) -> None:
        self._levels = [Extrema.none(CAPACITY, channels) for _ in range(LEVELS)]
        self._closed = [0] * LEVELS

    def closed(self, level: int) -> int:
        """How many buckets of the level are closed."""
        return self._closed[level]

    def take(self, t_s: Floats, values: Floats, channels: slice) -> None:
        """Samples (m, some of the channels) at `t_s` (m,)."""
        if not len(t_s):
            return
        places, extrema = gathered(np.maximum((t_s / BASE_S).astype(np.int64), self._closed[0]), values)
        while len(places):
            now = places < self._closed[0] + AHEAD
            self._put(places[now], Extrema(extrema.low[now], extrema.high[now]), channels)
            places, extrema = places[~now], Extrema(extrema.low[~now], extrema.high[~now])
            if len(places):
                self._close_to(int(places[0]) + 1 - AHEAD // 2)

    def _put(self, places: np.ndarray, extrema: Extrema, channels: slice) -> None:
        base, slots = self._levels[0], places % CAPACITY
        base.low[slots, channels] = np.fmin(base.low[slots, channels], extrema.low)
        base.high[slots, channels] = np.fmax(base.high[slots, channels], extrema.high)

    def close_before(self, t_s: float) -> None:
        """Everything before that time has come, or is not waited for any longer."""
        self._close_to(floor(t_s / BASE_S))

    def _close_to(self, bucket: int) -> None:
        if bucket - self._closed[0] > AHEAD + CAPACITY:
            self._step_to(self._closed[0] + AHEAD)
            self._leap_to(bucket)
        self._step_to(bucket)

    def _step_to(self, bucket: int) -> None:
        while self._closed[0] < bucket:
            begin, end = self._closed[0], min(bucket, self._closed[0] + AHEAD // 2)
            self._forget(begin + AHEAD, end + AHEAD)
            self._closed[0] = end
            self._pass_on()

    def _leap_to(self, bucket: int) -> None:
        """Over a long time without a sample, when nothing at all is open; what each level's open bucket has so far stays in it."""
        begun, base = self._begun(), self._levels[0]
        base.low[:] = base.high[:] = np.nan
        for level in range(LEVELS):
            first, end = self._closed[level], bucket >> level
            slots = np.arange(max(first, end - CAPACITY), end) % CAPACITY
            here = self._levels[level]
            here.low[slots] = here.high[slots] = np.nan
            if end - CAPACITY <= first < end:
                here.low[first % CAPACITY], here.high[first % CAPACITY] = begun[level].low[0], begun[level].high[0]
            self._closed[level] = end

    def _begun(self) -> list[Extrema]:
        """What each level's open bucket has so far: of the level below the bucket before the open one where that is its first half."""
        begun = [Extrema.none(1, self._levels[0].low.shape[1])]
        for level in range(1, LEVELS):
            first = 2 * self._closed[level]
            half, rest = self._slots(level - 1, first, min(first + 1, self._closed[level - 1])), begun[-1]
            both = Extrema(np.concatenate([half.low, rest.low]), np.concatenate([half.high, rest.high]))
            begun.append(Extrema(np.fmin.reduce(both.low, keepdims=True), np.fmax.reduce(both.high, keepdims=True)))
        return begun

    def _forget(self, begin: int, end: int) -> None:
        """Slots of level 0 that will be open now held what is too old."""
        slots = np.arange(begin, end) % CAPACITY
        self._levels[0].low[slots] = self._levels[0].high[slots] = np.nan

    def _pass_on(self) -> None:
        for level in range(1, LEVELS):
            begin, end = self._closed[level], self._closed[level - 1] // 2
            if begin == end:
                return
            pairs = self._slots(level - 1, 2 * begin, 2 * end).halved()
            slots = np.arange(begin, end) % CAPACITY
            self._levels[level].low[slots], self._levels[level].high[slots] = pairs.low, pairs.high
            self._closed[level] = end

    def _slots(self, level: int, begin: int, end: int) -> Extrema:
        slots = np.arange(begin, end) % CAPACITY
        return Extrema(self._levels[level].low[slots], self._levels[level].high[slots])

    def oldest(self, level: int) -> int:
        """The first bucket that is still remembered."""
        return max(self._closed[level] - (CAPACITY - AHEAD if level == 0 else CAPACITY), 0)

    def between(self, level: int, begin: int, end: int) -> Extrema:
        """Buckets begin to before end, all closed; those that nobody remembers are NaN."""
        begin_known = min(max(begin, self.oldest(level)), end)
        known, older = self._slots(level, begin_known, end), Extrema.none(begin_known - begin, self._levels[level].low.shape[1])
        return Extrema(np.concatenate([older.low, known.low]), np.concatenate([older.high, known.high]))


def width_s(level: int) -> float:
    """Of a bucket."""
    return float(BASE_S * 2**level)


def level_for(span_s: float) -> int:
    """The finest level at which a window of that length has no more than ACROSS buckets."""
    return next((level for level in range(LEVELS) if ACROSS * width_s(level) >= span_s * (1 - 1e-9)), LEVELS - 1)
