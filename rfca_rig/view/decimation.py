"""Decimation of traces for display: minimum and maximum of every bucket of time (min/max decimation).

A picture drawn from both shows every recorded peak at any zoom.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Numbers = NDArray[np.int64]


@dataclass(frozen=True)
class Extrema:
    """Minimum `low` and maximum `high`, both (n, channels), of n consecutive buckets; NaN where a bucket has no sample."""

    low: Floats
    high: Floats

    @staticmethod
    def none(buckets: int, channels: int) -> "Extrema":
        """Buckets without samples, (buckets, channels)."""
        return Extrema(np.full((buckets, channels), np.nan), np.full((buckets, channels), np.nan))

    def merge_pairs(self) -> "Extrema":
        """Pairs of buckets merged, (n / 2, channels); n must be even."""
        # fmin and fmax ignore NaN: a pair is empty only where both of its buckets are.
        return Extrema(np.fmin(self.low[::2], self.low[1::2]), np.fmax(self.high[::2], self.high[1::2]))


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
    # The prepended number differs from the first bucket, so that the first sample counts as a beginning.
    begins = np.flatnonzero(np.diff(buckets, prepend=buckets[0] - 1))
    return buckets[begins], Extrema(np.fmin.reduceat(values, begins), np.fmax.reduceat(values, begins))


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
    found = Extrema.none(count, values.shape[1])
    buckets = np.floor(t_s / dt_s).astype(np.int64) - first
    inside = (buckets >= 0) & (buckets < count)
    if inside.any():
        inside_buckets, extrema = extrema_by_bucket(buckets[inside], values[inside])
        found.low[inside_buckets], found.high[inside_buckets] = extrema.low, extrema.high
    return found
