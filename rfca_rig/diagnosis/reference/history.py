"""How nominal values have changed over many runs, each compared with one reference.

Entry points: `track_changes`, the changes in one run, and `fit_trend`, a straight line through
those of one value. All values of a run are estimated together, whether they have changed or not, so
that the interval of each holds what the others leave open.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from rfca_rig.analysis.fitting.space import FitParameter
from rfca_rig.diagnosis.inference.map_fit import GaussNewton, without_scatter
from rfca_rig.diagnosis.inference.model_selection import Progress
from rfca_rig.diagnosis.inference.parameterization import (
    EffectTerm,
    Parameterization,
    std_of,
    value_of,
)
from rfca_rig.diagnosis.likelihood.covariance import estimate_scatter
from rfca_rig.diagnosis.likelihood.marginal_likelihood import (
    laplace_posterior,
    make_marginal_likelihood,
)
from rfca_rig.diagnosis.reference.changes import list_changed_values, make_change
from rfca_rig.diagnosis.reference.conditions import compare_pair
from rfca_rig.diagnosis.reference.fit import fit_reference
from rfca_rig.diagnosis.reference.problem import ReferenceProblem
from rfca_rig.diagnosis.result import Value
from rfca_rig.errors import SimulationFailed
from rfca_rig.executors.cores import single_threaded_blas

Floats = NDArray[np.float64]

# Probability of the intervals, and that of a trend where there is none, of all values together.
INTERVAL = 0.9
FALSE_TRENDS = 0.05
# A straight line through fewer runs says nothing of their scatter.
FEWEST_RUNS = 4


@dataclass(frozen=True)
class Trend:
    """A straight line through the changes of one value in n runs.

    Parameters
    ----------
    over
        "time" where the value drifts with time, "runs" where it wears from run to run, whichever
        describes the changes better.
    change, half_width
        By how much the line rises from the first run to the last, and half of its interval of
        probability INTERVAL.
    is_clear
        Whether chance would make a trend as clear as this one in fewer than FALSE_TRENDS of all
        histories, whatever the number of values.
    fitted
        The line at each run, n values.
    """

    over: str
    change: float
    half_width: float
    is_clear: bool
    fitted: tuple[float, ...]


@single_threaded_blas()
def track_changes(problem: ReferenceProblem, progress: Progress) -> Mapping[str, Value]:
    """The change of each nominal value since the reference, by its name: in percent where it is
    relative, else in its own unit.

    Raises BadInput where both cannot be compared, SimulationFailed where the model has no answer.
    """
    pair = problem.new.pair_with(problem.reference, (), progress)
    fit = fit_reference(pair, progress)
    nothing = Parameterization(fit.make_prior())
    compared = compare_pair(pair, nothing, fit, problem.parts)
    parameters = list_changed_values(pair)
    coordinates = nothing.with_terms([EffectTerm(make_change(value)) for value in parameters])
    optimizer = without_scatter(compared)
    start = optimizer.at(coordinates, np.zeros(coordinates.size))
    if start is None:
        raise SimulationFailed("the model cannot be computed with the values of the reference")
    refined = optimizer.refine(start)
    scatter = estimate_scatter(compared, coordinates.supposed(refined.x))
    likelihood = make_marginal_likelihood(compared.rows, scatter.columns)
    fitted = GaussNewton(compared, likelihood).converge(refined)
    linear = fitted.linear(compared.rows.measured)
    posterior = laplace_posterior(linear, likelihood.level(linear))
    deviations = np.sqrt(np.diag(posterior.covariance))
    changes = {}
    for number, parameter in enumerate(parameters):
        part = coordinates.part(number)
        (size,) = coordinates.choices[number].sizes
        z = float(posterior.mean[part][0])
        std = std_of(size, z, float(deviations[part][0]))
        changes[parameter.name] = _state(parameter, value_of(size, z), std)
    return changes


def _state(parameter: FitParameter[Any], size: float, std: float) -> Value:
    """A factor in percent, a difference as it is."""
    if parameter.relative:
        return Value(100.0 * (size - 1.0), 100.0 * std)
    return Value(size, std)


def fit_trend(began_s: Sequence[float], changes: Sequence[Value], values: int) -> Trend | None:
    """The straight line through the changes of one value, over time or from run to run.

    Weighted least squares. Where the changes scatter by more than their standard deviations, that
    scatter counts; error that all runs share with the reference moves the line and not its slope.

    Parameters
    ----------
    began_s
        When each run began, in seconds, ascending.
    changes
        The change in each run.
    values
        Number of values that are tracked.

    Returns
    -------
    Trend or None
        None for too few runs.
    """
    if len(changes) < FEWEST_RUNS:
        return None
    axes = {"runs": np.arange(len(changes), dtype=np.float64)}
    t_s = np.array(began_s)
    if np.ptp(t_s) > 0.0:
        axes["time"] = t_s - t_s[0]
    lines = {over: _fit_line(axis / axis[-1], changes) for over, axis in axes.items()}
    over = min(lines, key=lambda name: lines[name].misfit)
    line = lines[over]
    spare = len(changes) - 2
    half_width = float(stats.t.ppf(0.5 + 0.5 * INTERVAL, spare)) * line.std
    p_value = 2.0 * float(stats.t.sf(abs(line.rise) / line.std, spare))
    # Bonferroni: whatever the dependence between the values, and for two axes.
    is_clear = p_value < FALSE_TRENDS / (values * len(axes))
    return Trend(over, line.rise, half_width, is_clear, tuple(line.fitted.tolist()))


@dataclass(frozen=True)
class _Line:
    """Rise from the first run to the last with its standard deviation, values (n,) at each run, and
    mean square misfit in standard deviations.
    """

    rise: float
    std: float
    fitted: Floats
    misfit: float


def _fit_line(share: Floats, changes: Sequence[Value]) -> _Line:
    """The line over `share` (n,), from 0 at the first run to 1 at the last."""
    measured = np.array([change.value for change in changes])
    weight = 1.0 / np.array([max(change.std, 1e-12) for change in changes])
    design = np.column_stack([np.ones(len(share)), share])
    weighted = design * weight[:, None]
    line, *_ = np.linalg.lstsq(weighted, weight * measured, rcond=None)
    fitted = design @ line
    misfit = float(np.sum((weight * (measured - fitted)) ** 2)) / (len(changes) - 2)
    covariance = np.linalg.inv(weighted.T @ weighted) * max(misfit, 1.0)
    return _Line(float(line[1]), float(np.sqrt(covariance[1, 1])), fitted, misfit)
