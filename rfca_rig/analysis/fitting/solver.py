"""One descent: bounded least squares of whitened residuals and the prior's, with a Jacobian by central differences in one batch."""

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import OptimizeResult, least_squares

from rfca_rig.analysis.fitting.parameters import ModelPoint
from rfca_rig.analysis.fitting.problem import Problem
from rfca_rig.analysis.fitting.scatter import StrokeWhitening
from rfca_rig.analysis.fitting.space import Prior
from rfca_rig.errors import SimulationFailed

Floats = NDArray[np.float64]
Progress = Callable[[int, float], None]

# Step of the differences in standard deviations, 1e-3 to 3e-3 of a value. At a hundredth of it, the steps of the integrator make up a sixth
# of the derivative by mass.
DIFFERENCE_STEP = 0.1
# Residual of every row where the model cannot be computed.
FAILED_RESIDUAL = 1e4
# In standard deviations, and relative for chi2. Below it, the integrator's own error would be fitted.
TOLERANCE = 1e-5


@dataclass
class Residuals:
    """Whitened residuals (m,) of the problem, followed by the prior's rows (q,); counts the points that it computed. Points are (p,)."""

    problem: Problem
    space: Prior[ModelPoint]
    progress: Progress
    whitening: StrokeWhitening = field(default_factory=StrokeWhitening)
    computed: int = 0

    def at(self, points: list[Floats]) -> list[Floats | None]:
        """Rows (m + q,) of problem and prior for each x (p,); None where the model cannot be computed."""
        found = self.problem.residuals([self.space.at(x) for x in points])
        self.computed += len(points)
        has_prior = self.space.has_prior
        return [None if r is None else np.concatenate([self.whitening(r), x[has_prior]]) for r, x in zip(found, points, strict=True)]

    def __call__(self, x: Floats) -> Floats:
        residuals = self.at([x])[0]
        if residuals is None:
            # The solver then shortens its step. NaN or an exception would end it.
            return np.full(self.data_rows + int(self.space.has_prior.sum()), FAILED_RESIDUAL)
        self.progress(self.computed, float(residuals @ residuals))
        return residuals

    def jacobian(self, x: Floats) -> Floats:
        """Jacobian (m + q, p) by central differences of order 2, computed in one batch at x (p,).

        Differences are one-sided, of order 1, where the model cannot be computed on one side. Raises SimulationFailed where it fails on
        both.
        """
        steps = DIFFERENCE_STEP * np.eye(len(x))
        here, *around = self.at([x, *(x + step for step in steps), *(x - step for step in steps)])
        return np.column_stack([self._slope(i, here, around[i], around[i + len(x)]) for i in range(len(x))])

    def _slope(self, i: int, here: Floats | None, ahead: Floats | None, behind: Floats | None) -> Floats:
        if ahead is not None and behind is not None:
            return (ahead - behind) / (2.0 * DIFFERENCE_STEP)
        if here is not None and ahead is not None:
            return (ahead - here) / DIFFERENCE_STEP
        if here is not None and behind is not None:
            return (here - behind) / DIFFERENCE_STEP
        raise SimulationFailed(f"the model cannot be computed around {self.space.names[i]}; are the nominal values right?")

    @property
    def data_rows(self) -> int:
        return len(self.problem.stroke_of_row)


def descend(residuals: Residuals, start: Floats, most_evaluations: int) -> OptimizeResult:
    """From `start` (p,) to the nearest local minimum of the sum of squares."""
    lower, upper = residuals.space.bounds()
    return least_squares(
        residuals,
        # The method needs a start strictly inside its bounds.
        np.clip(start, lower + 1e-6, upper - 1e-6),
        jac=residuals.jacobian,
        bounds=(lower, upper),
        method="trf",
        ftol=TOLERANCE,
        xtol=TOLERANCE,
        gtol=None,
        max_nfev=most_evaluations,
    )
