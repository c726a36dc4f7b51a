"""A block of gage voltages from a data acquisition card."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True, eq=False)
class GageBlock:
    """Consecutive samples: the number of the first since the start, from 0, and `volts` (m, channels)."""

    first: int
    volts: NDArray[np.float64]
