"""Most probable parameter values, given recordings and prior: multiple starts, scatter between
strokes, standard errors.

One descent is bounded least squares of whitened residuals and the prior's, with a Jacobian by
central differences in one batch.

Standard errors of a fit whose residuals are correlated within a stroke.

Quantities that differ from stroke to stroke (friction, height, how the leg swings at the start)
move all residuals of a stroke together. The textbook covariance counts every value as independent
and is then several times too small. With enough strokes, their own scatter gives the errors (White,
Econometrica 48 (1980) 817, summed over clusters as Liang and Zeger, Biometrika 73 (1986) 13). With
few strokes, the textbook covariance is widened by one factor.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Protocol

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import OptimizeResult, least_squares
from scipy.stats import norm, qmc

from rfca_rig.analysis.fitting.parameters import PARAMETERS, ModelPoint
from rfca_rig.analysis.fitting.result import FitResult, Starts
from rfca_rig.analysis.fitting.scatter import StrokeWhitening, estimate_scatter_std, make_whitening
from rfca_rig.analysis.fitting.space import MAX_SHIFT_STD, Prior
from rfca_rig.errors import SimulationFailed
from rfca_rig.executors.mapping import TaskExecutor, TaskFailure, map_unordered

Floats = NDArray[np.float64]

# Fewer clusters make the sandwich estimate itself too uncertain.
ENOUGH_STROKES = 10
Progress = Callable[[int, float], None]

# Step of the differences in standard deviations, 1e-3 to 3e-3 of a value. At a hundredth of it, the
# steps of the integrator make up a sixth of the derivative by mass.
DIFFERENCE_STEP = 0.1
# Residual of every row where the model cannot be computed.
FAILED_RESIDUAL = 1e4
# In standard deviations, and relative for chi2. Below it, the integrator's own error would be
# fitted.
TOLERANCE = 1e-5

# Starts agree if they end this close, in prior standard deviations, or within a standard error.
AGREEMENT_STD = 0.1
# Points of the prior that are evaluated for each start that is then taken.
SCREENED_PER_START = 16


def estimate_covariance(
    residuals: Floats,
    jacobian: Floats,
    has_prior: NDArray[np.bool_],
    stroke_of_row: NDArray[np.intp],
) -> tuple[Floats, str]:
    """Covariance of the fitted coordinates, and a description of its source.

    Parameters
    ----------
    residuals : (m,) of the data at the solution, in units of noise
    jacobian : (m, p) of the same rows
    has_prior : (p,) the prior is 1 per coordinate that has one
    stroke_of_row : (m,) index of the stroke of each row

    Returns
    -------
    covariance : (p, p)
    description : in words

    Notes
    -----
    A coordinate without a prior is taken to lie within its bounds. Otherwise a coordinate that
    nothing determines would have an infinite error.

    References
    ----------
    White (1980); Liang and Zeger (1986).
    """
    prior = np.diag(np.where(has_prior, 1.0, MAX_SHIFT_STD**-2))
    information = jacobian.T @ jacobian
    inverse = np.linalg.inv(information + prior)
    scatter, strokes = _scatter(residuals, jacobian, stroke_of_row)
    if strokes >= max(ENOUGH_STROKES, 2 * jacobian.shape[1]):
        # Sandwich estimator: the information is replaced by the observed scatter of the strokes'
        # gradients.
        return inverse @ (
            scatter + prior
        ) @ inverse, f"errors from the scatter between {strokes} strokes"
    free = max(len(residuals) - jacobian.shape[1], 1)
    # The larger of the reduced chi2 and the mean ratio of observed to assumed scatter; errors are
    # never made smaller.
    factor = max(
        1.0,
        float(residuals @ residuals) / free,
        float(np.trace(inverse @ scatter) / np.trace(inverse @ information)),
    )
    return inverse @ (
        factor * information + prior
    ) @ inverse, f"errors from the noise, widened {np.sqrt(factor):.1f} times"


def _scatter(
    residuals: Floats, jacobian: Floats, stroke_of_row: NDArray[np.intp]
) -> tuple[Floats, int]:
    """Sum over strokes of the outer product of each stroke's gradient with respect to the
    parameters.
    """
    strokes = int(stroke_of_row.max()) + 1
    pulls = np.array(
        [jacobian[stroke_of_row == s].T @ residuals[stroke_of_row == s] for s in range(strokes)]
    )
    # The factor corrects for few clusters.
    return pulls.T @ pulls * strokes / max(strokes - 1, 1), strokes


class LeastSquaresProblem(Protocol):
    """Residuals (m,) are simulated minus measured, each over its own standard deviation."""

    @property
    def stroke_of_row(self) -> NDArray[np.intp]:
        """Index of the stroke of each residual, (m,): scatter from stroke to stroke moves the
        residuals of one stroke together.
        """
        ...

    def residuals(self, supposed: Sequence[ModelPoint]) -> list[Floats | None]:
        """Residuals (m,) at each point; None where the model cannot be computed."""
        ...


@dataclass
class Residuals:
    """Whitened residuals (m,) of the problem, followed by the prior's rows (q,); counts the
    points that it computed. Points are (p,).
    """

    problem: LeastSquaresProblem
    space: Prior[ModelPoint]
    progress: Progress
    whitening: StrokeWhitening = field(default_factory=StrokeWhitening)
    computed: int = 0

    def at(self, points: list[Floats]) -> list[Floats | None]:
        """Rows (m + q,) of problem and prior for each x (p,); None where the model cannot be
        computed.
        """
        residuals = self.problem.residuals([self.space.at(x) for x in points])
        self.computed += len(points)
        has_prior = self.space.has_prior
        rows: list[Floats | None] = []
        for residual, x in zip(residuals, points, strict=True):
            if residual is None:
                rows.append(None)
            else:
                rows.append(np.concatenate([self.whitening(residual), x[has_prior]]))
        return rows

    def __call__(self, x: Floats) -> Floats:
        residuals = self.at([x])[0]
        if residuals is None:
            # The solver then shortens its step. NaN or an exception would end it.
            return np.full(self.data_rows + int(self.space.has_prior.sum()), FAILED_RESIDUAL)
        self.progress(self.computed, float(residuals @ residuals))
        return residuals

    def jacobian(self, x: Floats) -> Floats:
        """Jacobian (m + q, p) by central differences of order 2, computed in one batch at x (p,).

        Differences are one-sided, of order 1, where the model cannot be computed on one side.
        Raises SimulationFailed where it fails on both.
        """
        steps = DIFFERENCE_STEP * np.eye(len(x))
        # The two sides of each difference are neighbours, which move side by side with the same
        # steps.
        *around, centre = self.at([*(x + sign * step for step in steps for sign in (1.0, -1.0)), x])
        return np.column_stack(
            [self._slope(i, centre, around[2 * i], around[2 * i + 1]) for i in range(len(x))]
        )

    def _slope(
        self, i: int, centre: Floats | None, ahead: Floats | None, behind: Floats | None
    ) -> Floats:
        if ahead is not None and behind is not None:
            return (ahead - behind) / (2.0 * DIFFERENCE_STEP)
        if centre is not None and ahead is not None:
            return (ahead - centre) / DIFFERENCE_STEP
        if centre is not None and behind is not None:
            return (centre - behind) / DIFFERENCE_STEP
        raise SimulationFailed(
            f"the model cannot be computed around {self.space.names[i]}; are the nominal "
            "values right?"
        )

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


def _silent(simulated: int, chi2: float) -> None:
    del simulated, chi2


@dataclass(frozen=True)
class Search:
    """How to search for the most probable point.

    `start` gives values to begin from, by parameter name; others begin at their nominal value. With
    `starts` above 1, further starts are the best of a Sobol sample of the prior, shifted by `rng`.
    `progress` receives the number of points computed so far and the chi2 of the last one. An
    `executor` runs several descents at once, with bitwise the same result.
    """

    starts: int = 1
    start: Mapping[str, float] = field(default_factory=dict)
    rng: np.random.Generator | None = None
    most_evaluations: int = 60
    progress: Progress = _silent
    executor: TaskExecutor | None = None


def fit(
    problem: LeastSquaresProblem,
    space: Prior[ModelPoint],
    search: Search | None = None,
    scatter: Mapping[str, float] | None = None,
) -> FitResult:
    """The most probable point of `space`: least squares of the problem's residuals and of the
    prior's.

    Parameters
    ----------
    problem
        Residuals to minimise.
    space
        Parameters with their priors.
    search
        Starts, limits and progress.
    scatter
        Parameters that differ from stroke to stroke, with the usual standard deviation in their
        units; empty for none.

    Raises
    ------
    SimulationFailed
        Where the model cannot be computed at the nominal values.
    """
    search = search or Search()
    scatter = dict(scatter or {})
    residuals = Residuals(problem, space, search.progress)
    if residuals.at([np.zeros(len(space.std))])[0] is None:
        raise SimulationFailed(
            "the model cannot be computed with its nominal values; is a decimal point of "
            "leg or ground misplaced?"
        )
    # Whitening needs a point to linearise at. All starts share it, so that their costs can be
    # compared.
    first = np.zeros(len(space.std))
    for name, value in search.start.items():
        first[space.names.index(name)] = space.point(name, value)
    _whiten(residuals, first, scatter)
    runs = _descend_all(residuals, [first, *_screen_prior(residuals, search)], search)
    best = min(runs, key=lambda run: float(run.cost))
    # Number of starts that ended within a standard error, or a tenth of a prior's, of the best one.
    covariance, _ = _covariance(residuals, best)
    near = np.maximum(AGREEMENT_STD, np.sqrt(np.diag(covariance)))
    agreeing = sum(bool((np.abs(run.x - best.x) < near).all()) for run in runs)
    if scatter:
        # The scatter is estimated at the solution, and the fit repeated once with it.
        scatter = _whiten(residuals, best.x, scatter, learn=True)
        best = descend(residuals, best.x, search.most_evaluations)
    return replace(_result(residuals, best), starts=Starts(len(runs), agreeing), scatter=scatter)


def _descend_all(
    residuals: Residuals, starts: list[Floats], search: Search
) -> list[OptimizeResult]:
    """The descents in the order of their starts. Raises SimulationFailed where one was lost."""
    if search.executor is None:
        return [descend(residuals, start, search.most_evaluations) for start in starts]
    descents: dict[int, OptimizeResult] = {}
    descent = partial(
        _descent,
        _PicklableSpace.of(residuals.space),
        residuals.problem,
        residuals.whitening,
        search.most_evaluations,
    )
    # Results arrive in any order; they are put back into that of the starts, so that the choice of
    # the best is reproducible.
    for (number, _), back in map_unordered(search.executor, descent, list(enumerate(starts))):
        if isinstance(back, TaskFailure):
            raise SimulationFailed(
                f"the fit from start {number + 1} of {len(starts)} failed: {back.reason}"
            )
        descents[number], computed = back
        residuals.computed += computed
        residuals.progress(residuals.computed, 2.0 * float(descents[number].cost))
    return [descents[number] for number in range(len(starts))]


@dataclass(frozen=True)
class _PicklableSpace:
    """A space that can be sent to another process: its parameters are given by name, because
    their functions cannot be pickled.
    """

    names: tuple[str, ...]
    centre: ModelPoint
    std: Floats
    has_prior: NDArray[np.bool_]

    @classmethod
    def of(cls, space: Prior[ModelPoint]) -> "_PicklableSpace":
        return cls(tuple(space.names), space.centre, space.std, space.has_prior)

    def space(self) -> Prior[ModelPoint]:
        return Prior(
            tuple(PARAMETERS[name] for name in self.names), self.centre, self.std, self.has_prior
        )


def _descent(
    space: _PicklableSpace,
    problem: LeastSquaresProblem,
    whitening: StrokeWhitening,
    most_evaluations: int,
    start: tuple[int, Floats],
) -> tuple[OptimizeResult, int]:
    """One descent, in whichever process, and the number of points that it computed."""
    residuals = Residuals(problem, space.space(), _silent, whitening)
    return descend(residuals, start[1], most_evaluations), residuals.computed


def _screen_prior(residuals: Residuals, search: Search) -> list[Floats]:
    """The best of many points that cover the prior evenly."""
    if search.starts <= 1:
        return []
    dimensions = len(residuals.space.std)
    # Sobol sequences are balanced only for powers of 2.
    exponent = int(np.ceil(np.log2(SCREENED_PER_START * search.starts)))
    shift = (search.rng or np.random.default_rng(0)).random(dimensions)
    # A random shift modulo 1 (Cranley and Patterson) makes the sample random and keeps its even
    # cover.
    shares = (qmc.Sobol(dimensions, scramble=False).random_base2(exponent) + shift) % 1.0
    lower, upper = residuals.space.bounds()
    # The tails beyond 0.1 % are cut off: the normal quantile of 0 or 1 is infinite.
    points = list(np.clip(norm.ppf(np.clip(shares, 1e-3, 1.0 - 1e-3)), lower, upper))
    costs = [np.inf if r is None else float(r @ r) for r in residuals.at(points)]
    return [points[i] for i in np.argsort(costs, kind="stable")[: search.starts - 1]]


def _whiten(
    residuals: Residuals, x: Floats, scatter: Mapping[str, float], learn: bool = False
) -> dict[str, float]:
    """Whitens the residuals with the scatter's effect at x; returns its deviations. With `learn`
    these are estimated from the strokes.
    """
    if not scatter:
        return {}
    stroke_of_row = residuals.problem.stroke_of_row
    parameters = tuple(PARAMETERS[name] for name in scatter)
    spread = np.array([parameter.spread for parameter in parameters])
    around = Prior(parameters, residuals.space.at(x), spread, np.zeros(len(spread), dtype=bool))
    deviations = Residuals(residuals.problem, around, residuals.progress)
    std = np.array(list(scatter.values()))
    # The Jacobian counts steps of `spread`; dividing by it gives the effect per unit of each
    # parameter.
    effect = deviations.jacobian(np.zeros(len(std))) / spread
    if learn:
        std = estimate_scatter_std(std, effect * std, deviations(np.zeros(len(std))), stroke_of_row)
    residuals.whitening = make_whitening(effect * std, stroke_of_row)
    residuals.computed += deviations.computed
    return dict(zip(scatter, (float(s) for s in std), strict=True))


def _covariance(residuals: Residuals, best: OptimizeResult) -> tuple[Floats, str]:
    rows = residuals.data_rows
    return estimate_covariance(
        best.fun[:rows], best.jac[:rows], residuals.space.has_prior, residuals.problem.stroke_of_row
    )


def _result(residuals: Residuals, best: OptimizeResult) -> FitResult:
    rows = residuals.data_rows
    nominal = residuals(np.zeros(len(best.x)))
    covariance, errors_from = _covariance(residuals, best)
    return FitResult(
        space=residuals.space,
        x=best.x,
        covariance=covariance,
        at_bound=best.active_mask != 0,
        chi2_before=float(nominal[:rows] @ nominal[:rows]),
        chi2=float(best.fun[:rows] @ best.fun[:rows]),
        residuals=rows,
        strokes=int(residuals.problem.stroke_of_row.max()) + 1,
        errors_from=errors_from,
        evaluations=residuals.computed,
        converged=bool(best.success),
    )
