"""The reference, fitted without effects: joint posterior of the nuisance parameters, and what the
model leaves.
"""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rfca_rig.analysis.fitting.space import JointNormal, Prior
from rfca_rig.diagnosis.inference.model_selection import Progress, search_models
from rfca_rig.diagnosis.inference.parameterization import Parameterization
from rfca_rig.diagnosis.likelihood.marginal_likelihood import (
    laplace_posterior,
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
    dataset, space
        Its observations, and the prior that [known_to] states.
    free
        (n,) which parameters differ from one day to the next anyway.
    mean, covariance
        Posterior, (n,) and (n, n), in units of the prior's `std`.
    residuals
        (m,) measured less predicted at the mean.
    jacobian
        (m, n) derivatives of the predicted rows, per unit of the prior's `std`.
    error
        Most probable size of the model's error, as a share of the signals.
    groups
        The recordings of each command that was recorded more than once.
    repeats
        What differs between them; None where no command was repeated.
    scatter
        (m, k) directions in which the rows vary by one standard deviation: what differs from repeat
        to repeat within a condition.
    """

    dataset: Dataset
    space: Prior[Any]
    free: NDArray[np.bool_]
    mean: Floats
    covariance: Floats
    residuals: Floats
    jacobian: Floats
    error: float
    groups: tuple[tuple[Match, ...], ...]
    repeats: RepeatError | None
    scatter: Floats

    def make_prior(self, is_joint: bool = True) -> Prior[Any]:
        """The prior for recordings of another day: the posterior, with the stated priors of the
        parameters that are free; without correlations unless `is_joint`.
        """
        mean = np.where(self.free, 0.0, self.mean)
        covariance = np.where(self.free[:, None] | self.free, 0.0, self.covariance)
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


def fit_reference(pair: RecordingPair, progress: Progress) -> ReferenceFit:
    """Fit the nuisance parameters to the reference.

    Raises SimulationFailed where the nominal model cannot be simulated.
    """
    dataset = pair.reference
    search = search_models(dataset, Parameterization(pair.space), [], progress, pair.config)
    fitted = search.nothing.fitted
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
        dataset=dataset,
        space=pair.space,
        free=np.array([name in pair.free for name in pair.space.names], dtype=bool),
        mean=posterior.mean,
        covariance=posterior.covariance,
        residuals=linear.target - linear.jacobian @ posterior.mean,
        jacobian=linear.jacobian,
        error=whitening.s,
        groups=groups,
        repeats=repeats,
        scatter=search.scatter.columns,
    )


def scatter_by_recording(recording: NDArray[np.intp], effect: Floats) -> list[Floats]:
    """Columns (m, n), one array per recording: `effect` (m, n) in its rows, 0 in all others."""
    return [
        np.where((recording == number)[:, None], effect, 0.0)
        for number in range(int(recording.max()) + 1)
    ]
