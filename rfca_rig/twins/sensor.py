"""Sensor twin protocol."""

from typing import Protocol

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]


class SensorTwin(Protocol):
    """The sensor's side of the wire, advanced in steps: `take_requests`, `due`, then, after the plant has moved, `measured`."""

    def take_requests(self) -> None:
        """Executes requests received since the last step."""
        ...

    def due(self, to_s: float) -> Floats:
        """Sample times (m,) in s in the step that ends at `to_s`; none while none are requested."""
        ...

    def measured(self, wrench: Floats) -> None:
        """Takes the true wrench (m, 6) [N, N m] at the times that were due, and sends the records that are due."""
        ...
