"""How likely the recordings are under one hypothesis, with the size of the model's own error integrated out."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.special import logsumexp

from rfca_rig.diagnosis.config import NAMED_ERRORS, UNKNOWN_ERRORS, USUAL_ERROR
from rfca_rig.diagnosis.data.observations import Observations
from rfca_rig.diagnosis.likelihood.covariance import AtError, basis_of
from rfca_rig.diagnosis.likelihood.laplace import LinearModel, Posterior, laplace_posteriors

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class MarginalPosterior:
    """Log evidence, the model error s that goes with it (mean), and the posterior at the likeliest s, the usual one at least: that this
    model should err less than others is no knowledge to narrow an interval with.
    """

    log_evidence: float
    error: float
    posterior: Posterior
    whitening: AtError

    def farthest(self, nuisances: int) -> float:
        """How many deviations off the nuisance is that is farthest from where it is believed."""
        return float(np.abs(self.posterior.mean[:nuisances]).max(initial=0.0))


@dataclass(frozen=True)
class MarginalLikelihood:
    """Whitenings over the plausible errors of a model that lacks nothing, and of one that something unlisted is missing from."""

    named: tuple[AtError, ...]
    unknown: tuple[AtError, ...]

    def evaluate(self, linear: LinearModel, extra_directions: Floats | None = None) -> MarginalPosterior:
        """The hypothesis whose linear model this is, as if nothing else were missing; `extra_directions` as in `laplace_posteriors`."""
        half_normal = np.log(np.gradient(NAMED_ERRORS)) - 0.5 * (np.array(NAMED_ERRORS) / USUAL_ERROR) ** 2
        return _integrated(self.named, half_normal - logsumexp(half_normal), linear, extra_directions)

    def evaluate_unknown(self, linear: LinearModel) -> MarginalPosterior:
        """The same with something unlisted in it."""
        return _integrated(self.unknown, np.full(len(self.unknown), -np.log(len(self.unknown))), linear, None)

    def level(self, linear: LinearModel) -> AtError:
        """The whitening under which this linear model is likeliest, the usual one at least: what its misfit really is."""
        every = [whitening for whitening in (*self.named, *self.unknown[1:]) if whitening.s >= USUAL_ERROR]
        logs = [posterior.log_evidence for posterior in laplace_posteriors(linear, every)]
        return every[int(np.argmax(logs))]

    @cached_property
    def every_scale(self) -> tuple[AtError, ...]:
        """The whitenings at all discrepancy scales of the grid, ascending."""
        return tuple(sorted({whitening.s: whitening for whitening in (*self.unknown, *self.named)}.values(), key=lambda one: one.s))

    @property
    def usual(self) -> AtError:
        """The whitening at the usual model error."""
        return min(self.named, key=lambda whitening: abs(whitening.s - USUAL_ERROR))


def make_marginal_likelihood(rows: Observations, scatter: Floats) -> MarginalLikelihood:
    """The marginal likelihood of these rows; `scatter` (m, k) as B in `covariance`."""
    basis = basis_of(rows, scatter)
    return MarginalLikelihood(tuple(AtError(basis, s) for s in NAMED_ERRORS), tuple(AtError(basis, s) for s in UNKNOWN_ERRORS))


def _integrated(
    whitenings: tuple[AtError, ...], log_weights: Floats, linear: LinearModel, extra_directions: Floats | None
) -> MarginalPosterior:
    found = laplace_posteriors(linear, whitenings, extra_directions)
    logs = np.array([posterior.log_evidence for posterior in found]) + log_weights
    total = float(logsumexp(logs))
    least = next(i for i, whitening in enumerate(whitenings) if whitening.s >= USUAL_ERROR)
    at = max(int(np.argmax(logs)), least)
    error = float(np.exp(logs - total) @ np.array([whitening.s for whitening in whitenings]))
    return MarginalPosterior(total, error, found[at], whitenings[at])
