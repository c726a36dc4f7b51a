"""Minimum and maximum of a run's traces at every zoom level (a min/max pyramid), in memory that
does not grow.

Level 0 has buckets of half a millisecond; each level above has buckets twice as wide. Each level
keeps its newest buckets: seconds at the finest level, days at the coarsest.

A picture drawn from minimum and maximum of every bucket shows every recorded peak at any zoom.
"""

from dataclasses import dataclass
from math import floor

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Numbers = NDArray[np.int64]

# Width of a bucket of level 0. The shortest window of a page, 0.05 s, then has 100 buckets.
BASE_S = 5e-4
# The coarsest level has buckets of 2**23 * BASE_S = 70 min.
LEVELS = 24
# Buckets that a level keeps, as a ring.
CAPACITY = 4096
# Of level 0, at most so many buckets are open for samples. The other half of the ring holds closed
# ones that pages still read.
AHEAD = CAPACITY // 2
# A window is shown in at most so many buckets, about one for each pixel.
MAX_BUCKETS = 1000


@dataclass(frozen=True)
class Extrema:
    """Minimum `low` and maximum `high`, both (n, channels), of n consecutive buckets; NaN where
    a bucket has no sample.
    """

    low: Floats
    high: Floats

    @staticmethod
    def none(buckets: int, channels: int) -> "Extrema":
        """Buckets without samples, (buckets, channels)."""
        return Extrema(np.full((buckets, channels), np.nan), np.full((buckets, channels), np.nan))

    def merge_pairs(self) -> "Extrema":
        """Pairs of buckets merged, (n / 2, channels); n must be even."""
        # fmin and fmax ignore NaN: a pair is empty only where both of its buckets are.
        return Extrema(
            np.fmin(self.low[::2], self.low[1::2]), np.fmax(self.high[::2], self.high[1::2])
        )


def sort_by_bucket(buckets: Numbers, values: Floats) -> tuple[Numbers, Floats]:
    """Samples (m, channels) sorted by their buckets (m,); within a bucket they keep their order."""
    # The usual case: samples of one device arrive in order, and need no sort.
    if (np.diff(buckets) >= 0).all():
        return buckets, values
    order = np.argsort(buckets, kind="stable")
    return buckets[order], values[order]


def extrema_by_bucket(buckets: Numbers, values: Floats) -> tuple[Numbers, Extrema]:
    """Minimum and maximum of samples by bucket.

    Parameters
    ----------
    buckets
        Bucket number of each sample, (m,), m >= 1, in any order.
    values
        Samples, (m, channels); NaN counts as no sample.

    Returns
    -------
    buckets, extrema
        Distinct bucket numbers (n,), ascending, and their extrema (n, channels).
    """
    buckets, values = sort_by_bucket(buckets, values)
    # The prepended number differs from the first bucket, so that the first sample counts as a
    # beginning.
    begins = np.flatnonzero(np.diff(buckets, prepend=buckets[0] - 1))
    return buckets[begins], Extrema(
        np.fmin.reduceat(values, begins), np.fmax.reduceat(values, begins)
    )


def decimate(t_s: Floats, values: Floats, dt_s: float, first: int, count: int) -> Extrema:
    """Minimum and maximum of samples over a window of equal buckets.

    Parameters
    ----------
    t_s
        Times in s, (m,).
    values
        Samples, (m, channels).
    dt_s
        Width of a bucket in s.
    first
        Number of the first bucket, which begins at first * dt_s.
    count
        Number of buckets. Samples outside of the window are ignored.

    Returns
    -------
    Extrema
        (count, channels).
    """
    window = Extrema.none(count, values.shape[1])
    buckets = np.floor(t_s / dt_s).astype(np.int64) - first
    inside = (buckets >= 0) & (buckets < count)
    if inside.any():
        inside_buckets, extrema = extrema_by_bucket(buckets[inside], values[inside])
        window.low[inside_buckets] = extrema.low
        window.high[inside_buckets] = extrema.high
    return window


class Pyramid:
    """Takes samples in any order and in chunks of any size; a closed bucket does not change any
    more.

    Bucket n of level k begins at n * 2**k * BASE_S. A sample that comes too late for its bucket
    counts in the first open one, so that no peak is lost.
    """

    def __init__(self, channels: int) -> None:
        self._levels = [Extrema.none(CAPACITY, channels) for _ in range(LEVELS)]
        self._closed = [0] * LEVELS

    def count_closed(self, level: int) -> int:
        """Number of closed buckets of a level, which is also the number of its open bucket."""
        return self._closed[level]

    def take(self, t_s: Floats, values: Floats, channels: slice) -> None:
        """Takes in samples (m, k) at `t_s` (m,) s, of the k channels in `channels`."""
        if not len(t_s):
            return
        places, extrema = extrema_by_bucket(
            np.maximum((t_s / BASE_S).astype(np.int64), self._closed[0]), values
        )
        # Samples farther ahead than the ring is long are taken in steps, closing buckets in
        # between.
        while len(places):
            now = places < self._closed[0] + AHEAD
            self._add(places[now], Extrema(extrema.low[now], extrema.high[now]), channels)
            places = places[~now]
            extrema = Extrema(extrema.low[~now], extrema.high[~now])
            if len(places):
                self._close_to(int(places[0]) + 1 - AHEAD // 2)

    def _add(self, places: np.ndarray, extrema: Extrema, channels: slice) -> None:
        base = self._levels[0]
        slots = places % CAPACITY
        # fmin and fmax take the number where one side is NaN, which an empty bucket is.
        base.low[slots, channels] = np.fmin(base.low[slots, channels], extrema.low)
        base.high[slots, channels] = np.fmax(base.high[slots, channels], extrema.high)

    def close_before(self, t_s: float) -> None:
        """Closes all buckets that end before `t_s`: their samples have arrived, or are not
        waited for any longer.
        """
        self._close_to(floor(t_s / BASE_S))

    def _close_to(self, bucket: int) -> None:
        # After a long silence nothing is open any more, and buckets that are all empty need no
        # stepping.
        if bucket - self._closed[0] > AHEAD + CAPACITY:
            self._step_to(self._closed[0] + AHEAD)
            # A long time without samples is skipped when level 0 holds nothing open. What coarser
            # open buckets hold so far stays in them.
            open_buckets = self._open_buckets()
            base = self._levels[0]
            base.low[:] = base.high[:] = np.nan
            for level in range(LEVELS):
                first = self._closed[level]
                end = bucket >> level
                slots = np.arange(max(first, end - CAPACITY), end) % CAPACITY
                ring = self._levels[level]
                ring.low[slots] = ring.high[slots] = np.nan
                if end - CAPACITY <= first < end:
                    ring.low[first % CAPACITY] = open_buckets[level].low[0]
                    ring.high[first % CAPACITY] = open_buckets[level].high[0]
                self._closed[level] = end
        self._step_to(bucket)

    def _step_to(self, bucket: int) -> None:
        while self._closed[0] < bucket:
            # At most half of AHEAD at once, so that slots are not cleared before the level above
            # has read them.
            begin = self._closed[0]
            end = min(bucket, self._closed[0] + AHEAD // 2)
            # Empties slots of level 0 for buckets that are now open; their old content was CAPACITY
            # buckets earlier.
            slots = np.arange(begin + AHEAD, end + AHEAD) % CAPACITY
            self._levels[0].low[slots] = self._levels[0].high[slots] = np.nan
            self._closed[0] = end
            self._merge_upwards()

    def _open_buckets(self) -> list[Extrema]:
        """Content so far of each level's open bucket.

        It is the open bucket of the level below, and, where that is the second half, also the
        closed bucket before it.
        """
        open_buckets = [Extrema.none(1, self._levels[0].low.shape[1])]
        for level in range(1, LEVELS):
            first = 2 * self._closed[level]
            half = self._read_slots(level - 1, first, min(first + 1, self._closed[level - 1]))
            rest = open_buckets[-1]
            both = Extrema(
                np.concatenate([half.low, rest.low]), np.concatenate([half.high, rest.high])
            )
            open_buckets.append(
                Extrema(
                    np.fmin.reduce(both.low, keepdims=True),
                    np.fmax.reduce(both.high, keepdims=True),
                )
            )
        return open_buckets

    def _merge_upwards(self) -> None:
        for level in range(1, LEVELS):
            begin = self._closed[level]
            end = self._closed[level - 1] // 2
            # A level changes only where the one below did: all coarser ones are up to date then.
            if begin == end:
                return
            pairs = self._read_slots(level - 1, 2 * begin, 2 * end).merge_pairs()
            slots = np.arange(begin, end) % CAPACITY
            self._levels[level].low[slots] = pairs.low
            self._levels[level].high[slots] = pairs.high
            self._closed[level] = end

    def _read_slots(self, level: int, begin: int, end: int) -> Extrema:
        slots = np.arange(begin, end) % CAPACITY
        return Extrema(self._levels[level].low[slots], self._levels[level].high[slots])

    def oldest(self, level: int) -> int:
        """The first bucket that a level still holds."""
        kept = CAPACITY
        # In level 0 the slots of open buckets take part of the ring.
        if level == 0:
            kept -= AHEAD
        return max(self._closed[level] - kept, 0)

    def between(self, level: int, begin: int, end: int) -> Extrema:
        """Extrema (end - begin, channels) of closed buckets `begin` to before `end`; those no
        longer held are NaN.
        """
        begin_known = min(max(begin, self.oldest(level)), end)
        known = self._read_slots(level, begin_known, end)
        older = Extrema.none(begin_known - begin, self._levels[level].low.shape[1])
        return Extrema(
            np.concatenate([older.low, known.low]), np.concatenate([older.high, known.high])
        )


def width_s(level: int) -> float:
    """Width of a bucket of a level in s."""
    return float(BASE_S * 2**level)


def level_for(span_s: float) -> int:
    """The finest level at which a window of `span_s` s has at most MAX_BUCKETS buckets."""
    # The tolerance lets a span that is exactly MAX_BUCKETS buckets wide, up to rounding, keep its
    # level.
    return next(
        (level for level in range(LEVELS) if MAX_BUCKETS * width_s(level) >= span_s * (1 - 1e-9)),
        LEVELS - 1,
    )
