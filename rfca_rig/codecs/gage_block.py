"""What a sampling card hands over of a transducer's gage voltages."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True, eq=False)
class GageBlock:
    """Samples in a row: the number of the first since the start, from 0, and `volts` (m, channels)."""

    first: int
    volts: NDArray[np.float64]
