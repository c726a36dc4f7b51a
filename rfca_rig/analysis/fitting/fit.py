"""Most probable parameter values, given recordings and prior: multiple starts, scatter between strokes, standard errors."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import partial

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import OptimizeResult
from scipy.stats import norm, qmc

from rfca_rig.analysis.fitting.errors_of_fit import estimate_covariance
from rfca_rig.analysis.fitting.parameters import PARAMETERS, ModelPoint
from rfca_rig.analysis.fitting.problem import Problem
from rfca_rig.analysis.fitting.result import FitResult, Starts
from rfca_rig.analysis.fitting.scatter import StrokeWhitening, estimate_scatter_std, make_whitening
from rfca_rig.analysis.fitting.solver import Progress, Residuals, descend
from rfca_rig.analysis.fitting.space import Prior
from rfca_rig.errors import SimulationFailed
from rfca_rig.executors.mapping import TaskExecutor, TaskFailure, map_unordered

Floats = NDArray[np.float64]

# Starts agree if they end this close, in prior standard deviations, or within a standard error.
AGREEMENT_STD = 0.1
# Points of the prior that are evaluated for each start that is then taken.
SCREENED_PER_START = 16


def _silent(simulated: int, chi2: float) -> None:
    del simulated, chi2


@dataclass(frozen=True)
class Search:
    """How to search for the most probable point.

    `start` gives values to begin from, by parameter name; others begin at their nominal value. With `starts` above 1, further starts are
    the best of a Sobol sample of the prior, shifted by `rng`. `progress` receives the number of points computed so far and the chi2 of the
    last one. An `executor` runs several descents at once, with bitwise the same result.
    """

    starts: int = 1
    start: Mapping[str, float] = field(default_factory=dict)
    rng: np.random.Generator | None = None
    most_evaluations: int = 60
    progress: Progress = _silent
    executor: TaskExecutor | None = None


def fit(problem: Problem, space: Prior[ModelPoint], search: Search | None = None, scatter: Mapping[str, float] | None = None) -> FitResult:
    """The most probable point of `space`: least squares of the problem's residuals and of the prior's.

    Parameters
    ----------
    problem
        Residuals to minimise.
    space
        Parameters with their priors.
    search
        Starts, limits and progress.
    scatter
        Parameters that differ from stroke to stroke, with the usual standard deviation in their units; empty for none.

    Raises
    ------
    SimulationFailed
        Where the model cannot be computed at the nominal values.
    """
    search, scatter = search or Search(), dict(scatter or {})
    residuals = Residuals(problem, space, search.progress)
    if residuals.at([np.zeros(len(space.std))])[0] is None:
        raise SimulationFailed("the model cannot be computed as believed; look for a slipped decimal point in the leg or the ground")
    # Whitening needs a point to linearise at. All starts share it, so that their costs can be compared.
    first = _first_point(space, search)
    _whiten(residuals, first, scatter)
    runs = _descend_all(residuals, [first, *_screen_prior(residuals, search)], search)
    best = min(runs, key=lambda run: float(run.cost))
    agreeing = _agreeing(residuals, runs, best)
    if scatter:
        # The scatter is estimated at the solution, and the fit repeated once with it.
        scatter = _whiten(residuals, best.x, scatter, learn=True)
        best = descend(residuals, best.x, search.most_evaluations)
    return replace(_result(residuals, best), starts=Starts(len(runs), agreeing), scatter=scatter)


def _descend_all(residuals: Residuals, starts: list[Floats], search: Search) -> list[OptimizeResult]:
    """The descents in the order of their starts. Raises SimulationFailed where one was lost."""
    if search.executor is None:
        return [descend(residuals, start, search.most_evaluations) for start in starts]
    found: dict[int, OptimizeResult] = {}
    descent = partial(_descent, _PicklableSpace.of(residuals.space), residuals.problem, residuals.whitening, search.most_evaluations)
    # Results arrive in any order; they are put back into that of the starts, so that the choice of the best is reproducible.
    for (number, _), back in map_unordered(search.executor, descent, list(enumerate(starts))):
        if isinstance(back, TaskFailure):
            raise SimulationFailed(f"the fit from start {number + 1} of {len(starts)} failed: {back.reason}")
        found[number], computed = back
        residuals.computed += computed
        residuals.progress(residuals.computed, 2.0 * float(found[number].cost))
    return [found[number] for number in range(len(starts))]


@dataclass(frozen=True)
class _PicklableSpace:
    """A space that can be sent to another process: its parameters are given by name, because their functions cannot be pickled."""

    names: tuple[str, ...]
    centre: ModelPoint
    std: Floats
    has_prior: NDArray[np.bool_]

    @classmethod
    def of(cls, space: Prior[ModelPoint]) -> "_PicklableSpace":
        return cls(tuple(space.names), space.centre, space.std, space.has_prior)

    def space(self) -> Prior[ModelPoint]:
        return Prior(tuple(PARAMETERS[name] for name in self.names), self.centre, self.std, self.has_prior)


def _descent(
    space: _PicklableSpace, problem: Problem, whitening: StrokeWhitening, most_evaluations: int, start: tuple[int, Floats]
) -> tuple[OptimizeResult, int]:
    """One descent, in whichever process, and the number of points that it computed."""
    residuals = Residuals(problem, space.space(), _silent, whitening)
    return descend(residuals, start[1], most_evaluations), residuals.computed


def _first_point(space: Prior[ModelPoint], search: Search) -> Floats:
    first = np.zeros(len(space.std))
    for name, value in search.start.items():
        first[space.names.index(name)] = space.point(name, value)
    return first


def _screen_prior(residuals: Residuals, search: Search) -> list[Floats]:
    """The best of many points that cover the prior evenly."""
    if search.starts <= 1:
        return []
    dimensions = len(residuals.space.std)
    # Sobol sequences are balanced only for powers of 2.
    exponent = int(np.ceil(np.log2(SCREENED_PER_START * search.starts)))
    shift = (search.rng or np.random.default_rng(0)).random(dimensions)
    # A random shift modulo 1 (Cranley and Patterson) makes the sample random and keeps its even cover.
    shares = (qmc.Sobol(dimensions, scramble=False).random_base2(exponent) + shift) % 1.0
    lower, upper = residuals.space.bounds()
    # The tails beyond 0.1 % are cut off: the normal quantile of 0 or 1 is infinite.
    points = list(np.clip(norm.ppf(np.clip(shares, 1e-3, 1.0 - 1e-3)), lower, upper))
    costs = [np.inf if r is None else float(r @ r) for r in residuals.at(points)]
    return [points[i] for i in np.argsort(costs, kind="stable")[: search.starts - 1]]


def _whiten(residuals: Residuals, x: Floats, scatter: Mapping[str, float], learn: bool = False) -> dict[str, float]:
    """Whitens the residuals with the scatter's effect at x; returns its deviations. With `learn` these are estimated from the strokes."""
    if not scatter:
        return {}
    stroke_of_row = residuals.problem.stroke_of_row
    parameters = tuple(PARAMETERS[name] for name in scatter)
    spread = np.array([parameter.spread for parameter in parameters])
    around = Prior(parameters, residuals.space.at(x), spread, np.zeros(len(spread), dtype=bool))
    deviations = Residuals(residuals.problem, around, residuals.progress)
    std = np.array(list(scatter.values()))
    # The Jacobian counts steps of `spread`; dividing by it gives the effect per unit of each parameter.
    effect = deviations.jacobian(np.zeros(len(std))) / spread
    if learn:
        std = estimate_scatter_std(std, effect * std, deviations(np.zeros(len(std))), stroke_of_row)
    residuals.whitening = make_whitening(effect * std, stroke_of_row)
    residuals.computed += deviations.computed
    return dict(zip(scatter, (float(s) for s in std), strict=True))


def _agreeing(residuals: Residuals, runs: list[OptimizeResult], best: OptimizeResult) -> int:
    """Number of starts that ended within a standard error, or a tenth of a prior's, of the best one."""
    covariance, _ = _covariance(residuals, best)
    near = np.maximum(AGREEMENT_STD, np.sqrt(np.diag(covariance)))
    return sum(bool((np.abs(run.x - best.x) < near).all()) for run in runs)


def _covariance(residuals: Residuals, best: OptimizeResult) -> tuple[Floats, str]:
    rows = residuals.data_rows
    return estimate_covariance(best.fun[:rows], best.jac[:rows], residuals.space.has_prior, residuals.problem.stroke_of_row)


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
