"""Interface of a fit problem: residuals for many points at once."""

from collections.abc import Sequence
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from rfca_rig.analysis.fitting.parameters import ModelPoint

Floats = NDArray[np.float64]


class Problem(Protocol):
    """Residuals (m,) are simulated minus measured, each over its own standard deviation."""

    @property
    def stroke_of_row(self) -> NDArray[np.intp]:
        """Index of the stroke of each residual, (m,): scatter from stroke to stroke moves the residuals of one stroke together."""
        ...

    def residuals(self, supposed: Sequence[ModelPoint]) -> list[Floats | None]:
        """Residuals (m,) at each point; None where the model cannot be computed."""
        ...
