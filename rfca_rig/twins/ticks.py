"""Sample times on a fixed grid."""

from math import floor

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

# Share of a period: a time that rounding moved just past the end of a step still belongs to it.
SLACK = 1e-6

NO_TIMES = np.empty(0)


class SampleGrid:
    """The times n * period, n = 1, 2 ..., each returned once. They are computed from zero, so rounding errors do not accumulate."""

    def __init__(self, period_s: float) -> None:
        self._period_s = period_s
        self._taken = 0

    @property
    def taken(self) -> int:
        """Number of the last time returned."""
        return self._taken

    def until(self, to_s: float) -> Floats:
        """Times (m,) in s not yet returned, none later than `to_s`."""
        first, last = self._taken + 1, floor(to_s / self._period_s + SLACK)
        if last < first:
            return NO_TIMES
        self._taken = last
        times: Floats = np.minimum(np.arange(first, last + 1) * self._period_s, to_s)
        return times
