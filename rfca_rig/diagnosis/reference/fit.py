"""The reference, fitted without effects: joint posterior of the nuisance parameters, and what the
model leaves.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rfca_rig.analysis.fitting.space import JointNormal, Prior
from rfca_rig.diagnosis.config import MAX_COORDINATE, USUAL_ERROR
from rfca_rig.diagnosis.data import Observations
from rfca_rig.diagnosis.inference.hypotheses import ModelSelectionResult
from rfca_rig.diagnosis.inference.map_fit import GaussNewton, MapFit
from rfca_rig.diagnosis.inference.model_selection import Progress, search_models
from rfca_rig.diagnosis.inference.parameterization import Parameterization
from rfca_rig.diagnosis.likelihood.marginal_likelihood import (
    LinearModel,
    MarginalLikelihood,
    laplace_posterior,
    loo_log_densities,
    make_marginal_likelihood,
)
from rfca_rig.diagnosis.problem import RecordingPair
from rfca_rig.diagnosis.reference.matching import Match, find_repeats
from rfca_rig.diagnosis.reference.repeats import RepeatError, estimate_repeat_error
from rfca_rig.diagnosis.simulator import Dataset

Floats = NDArray[np.float64]

VALUE_STEP = 0.1  # prior standard deviations: read values are smooth in their coordinates


@dataclass(frozen=True)
class ReferenceFit:
    """The reference with m rows and n nuisance parameters.

    Parameters
    ----------
    optimizer, fitted
        The optimiser of its observations, and its fit without effects.
    space
        The prior that [known_to] states.
    free
        (n,) which parameters differ from one day to the next anyway.
    mean, covariance
        Posterior, (n,) and (n, n), in units of the prior's `std`.
    residuals
        (m,) measured less predicted at the mean.
    jacobian
        (m, n) derivatives of the predicted rows, per unit of the prior's `std`.
    error, transfer_error
        Most probable size of the model's error, as a share of the signals: in what the parameters
        were fitted to, and in motions of other commands.
    groups
        The recordings of each command that was recorded more than once.
    repeats
        What differs between them; None where no command was repeated.
    scatter
        (m, k) directions in which the rows vary by one standard deviation: what differs from repeat
        to repeat within a condition.
    """

    optimizer: GaussNewton
    fitted: MapFit
    space: Prior[Any]
    free: NDArray[np.bool_]
    mean: Floats
    covariance: Floats
    residuals: Floats
    jacobian: Floats
    error: float
    transfer_error: float
    groups: tuple[tuple[Match, ...], ...]
    repeats: RepeatError | None
    scatter: Floats

    @property
    def dataset(self) -> Dataset:
        """Its observations."""
        return self.optimizer.dataset

    @property
    def contradiction(self) -> float:
        """By how much the values that it found are farther from the stated ones than their stated
        uncertainties say: rms of the shifts, 1 at least.

        A value that takes up what a wrong law leaves takes up something else in other motions. With
        this factor the uncertainty of values that contradict each other is widened (Birge ratio:
        Birge, Phys. Rev. 40 (1932) 207).
        """
        stated = self.space.has_prior & ~self.free
        if not stated.any():
            return 1.0
        return max(float(np.sqrt(np.mean(self.mean[stated] ** 2))), 1.0)

    def make_prior(self, is_joint: bool = True, is_same_motion: bool = True) -> Prior[Any]:
        """The prior for recordings of another day: the posterior, with the stated priors of the
        parameters that are free; without correlations unless `is_joint`. For other motions, and
        where a value is no credible one, it is wider by the `contradiction`.
        """
        mean = np.where(self.free, 0.0, self.mean)
        covariance = np.where(self.free[:, None] | self.free, 0.0, self.covariance)
        is_credible = bool(np.all(np.abs(mean) <= MAX_COORDINATE))
        if not (is_same_motion and is_credible):
            covariance = covariance * self.contradiction**2
        if not is_joint:
            covariance = np.diag(np.diag(covariance))
        covariance = covariance + np.diag(self.free.astype(float))
        return replace(self.space, joint=JointNormal(mean, covariance))

    def read_values(self) -> Floats:
        """Values (n,) of all parameters at the posterior mean, as the input has them."""
        at = self.space.at(self.mean)
        return np.array([parameter.read(at) for parameter in self.space.parameters])

    def value_slopes(self) -> Floats:
        """Derivatives (n,) of these values per unit of the prior's `std`."""
        above = self.space.at(self.mean + VALUE_STEP)
        below = self.space.at(self.mean - VALUE_STEP)
        changes = [
            parameter.read(above) - parameter.read(below) for parameter in self.space.parameters
        ]
        return np.array(changes) / (2.0 * VALUE_STEP)


def fit_without_effects(pair: RecordingPair, progress: Progress) -> ModelSelectionResult:
    """The reference by the model without effects.

    Raises SimulationFailed where the nominal model cannot be simulated.
    """
    return search_models(pair.reference, Parameterization(pair.space), [], progress, pair.config)


def fit_reference(
    pair: RecordingPair, progress: Progress, search: ModelSelectionResult | None = None
) -> ReferenceFit:
    """Fit the nuisance parameters to the reference; `search` is its fit without effects, where that
    was made already.

    Raises SimulationFailed where the nominal model cannot be simulated.
    """
    dataset = pair.reference
    if search is None:
        search = fit_without_effects(pair, progress)
    fitted = _leave_bounds(search)
    rows = dataset.rows
    linear = fitted.linear(rows.measured)
    # The scatter of the parameters needs residuals, and the residuals need a posterior: a first one
    # without scatter is close enough, because all repeats share it.
    posterior = laplace_posterior(linear, search.likelihood.level(linear))
    residuals = linear.target - linear.jacobian @ posterior.mean
    groups = find_repeats(rows, pair.name_commands)
    repeats = estimate_repeat_error(rows, residuals, linear.jacobian, groups)
    columns = [search.scatter.columns]
    if repeats is not None:
        columns += scatter_by_recording(rows.recording, linear.jacobian * repeats.std)
    likelihood = make_marginal_likelihood(rows, np.column_stack(columns))
    whitening = likelihood.level(linear)
    posterior = laplace_posterior(linear, whitening)
    return ReferenceFit(
        optimizer=GaussNewton(dataset, likelihood),
        fitted=fitted,
        space=pair.space,
        free=np.array([name in pair.free for name in pair.space.names], dtype=bool),
        mean=posterior.mean,
        covariance=posterior.covariance,
        residuals=linear.target - linear.jacobian @ posterior.mean,
        jacobian=linear.jacobian,
        error=whitening.s,
        transfer_error=_measure_transfer_error(linear, likelihood, _number_commands(rows, groups)),
        groups=groups,
        repeats=repeats,
        scatter=search.scatter.columns,
    )


def _leave_bounds(search: ModelSelectionResult) -> MapFit:
    """The fit without effects; where a parameter is at its bound, as far beyond it as the reference
    asks for.

    A value that far off is no credible one, but it takes up what the model lacks in both recordings
    alike. At the bound it would leave some of that, and a linear fit, which knows no bound, would
    put it where the model was never simulated.
    """
    fitted = search.nothing.fitted
    if fitted.max_nuisance_shift < MAX_COORDINATE:
        return fitted
    optimizer = GaussNewton(search.dataset, search.likelihood, max_coordinate=np.inf)
    return optimizer.converge(fitted)


def _number_commands(rows: Observations, groups: Sequence[Sequence[Match]]) -> NDArray[np.intp]:
    """Number of the command of each row (m,): recordings of one group have the same. Where all
    have, that of its condition.
    """
    numbers = np.arange(int(rows.recording.max()) + 1)
    for group in groups:
        for match in group:
            numbers[match.recording] = group[0].recording
    commands = np.unique(numbers[rows.recording], return_inverse=True)[1].astype(np.intp)
    if commands.max() == 0:
        return rows.condition
    return commands


def _measure_transfer_error(
    linear: LinearModel, likelihood: MarginalLikelihood, commands: NDArray[np.intp]
) -> float:
    """Size of the model's error, as a share of the signals, with which the rows of each command
    are most probable given those of all others; the usual one at least.

    `commands` (m,) numbers the command of each row.
    """
    count = int(commands.max()) + 1
    candidates = [level for level in likelihood.every_scale if level.s >= USUAL_ERROR]
    if count < 2:
        return likelihood.level(linear).s
    log_densities = []
    for whitening in candidates:
        of_commands = loo_log_densities(linear, whitening, commands, range(count))
        log_densities.append(float(of_commands.sum()))
    return candidates[int(np.argmax(log_densities))].s


def scatter_by_recording(recording: NDArray[np.intp], effect: Floats) -> list[Floats]:
    """Columns (m, n), one array per recording: `effect` (m, n) in its rows, 0 in all others."""
    return [
        np.where((recording == number)[:, None], effect, 0.0)
        for number in range(int(recording.max()) + 1)
    ]
