"""One descent: bounded least squares over whitened residuals and the prior's, gradients by central differences in one batch."""

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import OptimizeResult, least_squares

from rfca_rig.analysis.fitting.parameters import Supposed
from rfca_rig.analysis.fitting.problem import Problem
from rfca_rig.analysis.fitting.scatter import StrokeWhitening
from rfca_rig.analysis.fitting.space import Space
from rfca_rig.errors import SimulationFailed

Floats = NDArray[np.float64]
Progress = Callable[[int, float], None]

STEP = 0.1  # of a std, 1e-3 to 3e-3 of a value: at a hundredth the integrator's own steps make up a sixth of the slope by mass
REFUSED = 1e4  # residual of every row where the model has no answer
TOLERANCE = 1e-5  # of a std, and of chi2: beyond it the integrator's own error is being fitted


@dataclass
class Residuals:
    """Whitened residuals of the problem with the prior's below, computed when asked and counted."""

    problem: Problem
    space: Space[Supposed]
    progress: Progress
    whitening: StrokeWhitening = field(default_factory=StrokeWhitening)
    computed: int = 0

    def at(self, points: list[Floats]) -> list[Floats | None]:
        """For each x the rows of the problem and of the prior; None where the model has no answer."""
        found = self.problem.residuals([self.space.at(x) for x in points])
        self.computed += len(points)
        has_prior = self.space.has_prior
        return [None if r is None else np.concatenate([self.whitening(r), x[has_prior]]) for r, x in zip(found, points, strict=True)]

    def __call__(self, x: Floats) -> Floats:
        residuals = self.at([x])[0]
        if residuals is None:
            return np.full(self.data_rows + int(self.space.has_prior.sum()), REFUSED)
        self.progress(self.computed, float(residuals @ residuals))
        return residuals

    def jacobian(self, x: Floats) -> Floats:
        """Central differences, all in one batch; one-sided where the model has no answer on the other side.

        Raises SimulationFailed where it has none on either side.
        """
        steps = STEP * np.eye(len(x))
        here, *around = self.at([x, *(x + step for step in steps), *(x - step for step in steps)])
        return np.column_stack([self._slope(i, here, around[i], around[i + len(x)]) for i in range(len(x))])

    def _slope(self, i: int, here: Floats | None, ahead: Floats | None, behind: Floats | None) -> Floats:
        if ahead is not None and behind is not None:
            return (ahead - behind) / (2.0 * STEP)
        if here is not None and ahead is not None:
            return (ahead - here) / STEP
        if here is not None and behind is not None:
            return (here - behind) / STEP
        raise SimulationFailed(f"the model cannot be computed around {self.space.names[i]}; are the nominal values right?")

    @property
    def data_rows(self) -> int:
        return len(self.problem.stroke_of_row)


def descend(residuals: Residuals, start: Floats, most_evaluations: int) -> OptimizeResult:
    """From `start` to the nearest valley of the sum of squares."""
    lower, upper = residuals.space.bounds()
    return least_squares(
        residuals,
        np.clip(start, lower + 1e-6, upper - 1e-6),
        jac=residuals.jacobian,
        bounds=(lower, upper),
        method="trf",
        ftol=TOLERANCE,
        xtol=TOLERANCE,
        gtol=None,
        max_nfev=most_evaluations,
    )
