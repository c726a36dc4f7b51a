"""Moments on a fixed grid."""

from math import floor

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

SLACK = 1e-6  # of a period: a moment that rounding pushed just past the end of a step still belongs to it

NONE_DUE = np.empty(0)


class Ticks:
    """The moments n * period, n = 1, 2 ..., handed out once each. The grid hangs on zero, so no rounding adds up."""

    def __init__(self, period_s: float) -> None:
        self._period_s = period_s
        self._taken = 0

    @property
    def taken(self) -> int:
        """Number of the last moment handed out."""
        return self._taken

    def until(self, to_s: float) -> Floats:
        """Moments (m,) not yet handed out, none later than `to_s`."""
        first, last = self._taken + 1, floor(to_s / self._period_s + SLACK)
        if last < first:
            return NONE_DUE
        self._taken = last
        times: Floats = np.minimum(np.arange(first, last + 1) * self._period_s, to_s)
        return times
