"""What the solver needs of anything it fits: residuals for many suppositions at once."""

from collections.abc import Sequence
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from rfca_rig.analysis.fitting.parameters import Supposed

Floats = NDArray[np.float64]


class Problem(Protocol):
    """Residuals are simulated minus measured, each over its own standard deviation."""

    @property
    def stroke_of_row(self) -> NDArray[np.intp]:
        """For each residual the stroke it belongs to, (m,): what differs from stroke to stroke moves its residuals together."""
        ...

    def residuals(self, supposed: Sequence[Supposed]) -> list[Floats | None]:
        """Residuals (m,) for each supposition; None where the model cannot be computed for it."""
        ...
