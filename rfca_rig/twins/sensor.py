"""A sensor twin as a world carries it along."""

from typing import Protocol

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]


class SensorTwin(Protocol):
    """The sensor's side of the wire; brought forward step by step: `take_requests`, `due`, then, after the plant moved, `measured`."""

    def take_requests(self) -> None:
        """Obeys what has come in since the last step."""
        ...

    def due(self, to_s: float) -> Floats:
        """Sample times (m,) in the step that ends at `to_s`; none while nobody wants any."""
        ...

    def measured(self, wrench: Floats) -> None:
        """Takes the true wrench (m, 6) [N, N m] at the times that were due, and sends what is ready."""
        ...
