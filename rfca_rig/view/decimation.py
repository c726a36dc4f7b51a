"""From thousands of samples a second to what a screen can show: the least and the greatest of every bucket of time.

A picture drawn from both shows every peak that was recorded, at whatever width.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Numbers = NDArray[np.int64]


@dataclass(frozen=True)
class Extrema:
    """`low` and `high` (n, channels) of buckets in a row; NaN where a bucket had no sample."""

    low: Floats
    high: Floats

    @staticmethod
    def none(buckets: int, channels: int) -> "Extrema":
        return Extrema(np.full((buckets, channels), np.nan), np.full((buckets, channels), np.nan))

    def halved(self) -> "Extrema":
        """Two buckets as one each; an even number of them."""
        return Extrema(np.fmin(self.low[::2], self.low[1::2]), np.fmax(self.high[::2], self.high[1::2]))


def in_order(buckets: Numbers, values: Floats) -> tuple[Numbers, Floats]:
    """Samples (m, channels) in the order of their buckets (m,)."""
    if (np.diff(buckets) >= 0).all():
        return buckets, values
    order = np.argsort(buckets, kind="stable")
    return buckets[order], values[order]


def gathered(buckets: Numbers, values: Floats) -> tuple[Numbers, Extrema]:
    """The buckets (n,) that samples (m, channels) fall into, at least one, each once and in order, and what is least and greatest there.

    NaN among the values is no sample.
    """
    buckets, values = in_order(buckets, values)
    begins = np.flatnonzero(np.diff(buckets, prepend=buckets[0] - 1))
    return buckets[begins], Extrema(np.fmin.reduceat(values, begins), np.fmax.reduceat(values, begins))


def decimated(t_s: Floats, values: Floats, dt_s: float, first: int, count: int) -> Extrema:
    """Samples (m, channels) at `t_s` (m,) in `count` buckets of `dt_s`, the first of which begins at first * dt_s; others are left out."""
    found = Extrema.none(count, values.shape[1])
    buckets = np.floor(t_s / dt_s).astype(np.int64) - first
    inside = (buckets >= 0) & (buckets < count)
    if inside.any():
        places, extrema = gathered(buckets[inside], values[inside])
        found.low[places], found.high[places] = extrema.low, extrema.high
    return found
