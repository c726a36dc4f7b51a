"""Marginal likelihood of the recordings under one hypothesis, with the discrepancy scale s integrated out.

The strict prior of s is half-normal with size USUAL_ERROR: nothing else is missing. With something unlisted, s is log-uniform over
UNKNOWN_ERRORS. Section 4 of docs/method.md states both.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.special import logsumexp

from rfca_rig.diagnosis.config import NAMED_ERRORS, UNKNOWN_ERRORS, USUAL_ERROR
from rfca_rig.diagnosis.data.observations import Observations
from rfca_rig.diagnosis.likelihood.covariance import DiscrepancyWhitening, make_basis
from rfca_rig.diagnosis.likelihood.laplace import LinearModel, Posterior, laplace_posteriors

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class MarginalPosterior:
    """Log evidence, mean discrepancy scale `error`, and posterior of the unknowns.

    The posterior is the one at the most probable s, but at least at the usual one. A fit that happens to be better than usual is no reason
    for a narrower interval.
    """

    log_evidence: float
    error: float
    posterior: Posterior
    whitening: DiscrepancyWhitening

    def max_nuisance_shift(self, nuisances: int) -> float:
        """Largest distance of a nuisance parameter from its prior mean, in prior standard deviations."""
        return float(np.abs(self.posterior.mean[:nuisances]).max(initial=0.0))


@dataclass(frozen=True)
class MarginalLikelihood:
    """Whitenings over the grids of plausible discrepancy scales.

    Parameters
    ----------
    named
        Scales of a model that lacks nothing else.
    unknown
        Scales of a model that lacks something unlisted.
    """

    named: tuple[DiscrepancyWhitening, ...]
    unknown: tuple[DiscrepancyWhitening, ...]

    def evaluate(self, linear: LinearModel, extra_directions: Floats | None = None) -> MarginalPosterior:
        """Evidence and posterior if nothing else is missing; `extra_directions` (m, k) as in `laplace_posteriors`."""
        # The grid is uneven, so each point has the width that it stands for as a weight.
        half_normal = np.log(np.gradient(NAMED_ERRORS)) - 0.5 * (np.array(NAMED_ERRORS) / USUAL_ERROR) ** 2
        return _integrate_scale(self.named, half_normal - logsumexp(half_normal), linear, extra_directions)

    def evaluate_unknown(self, linear: LinearModel) -> MarginalPosterior:
        """Evidence and posterior if something unlisted is missing beside the hypothesis."""
        return _integrate_scale(self.unknown, np.full(len(self.unknown), -np.log(len(self.unknown))), linear, None)

    def level(self, linear: LinearModel) -> DiscrepancyWhitening:
        """The whitening at the most probable scale, the usual one at least: it reflects the actual misfit of this linear model."""
        # Both grids contain the scale where they meet, hence [1:].
        every = [whitening for whitening in (*self.named, *self.unknown[1:]) if whitening.s >= USUAL_ERROR]
        logs = [posterior.log_evidence for posterior in laplace_posteriors(linear, every)]
        return every[int(np.argmax(logs))]

    @cached_property
    def every_scale(self) -> tuple[DiscrepancyWhitening, ...]:
        """The whitenings at all discrepancy scales of the grid, ascending."""
        return tuple(sorted({whitening.s: whitening for whitening in (*self.unknown, *self.named)}.values(), key=lambda one: one.s))

    @property
    def usual(self) -> DiscrepancyWhitening:
        """The whitening at the usual model error."""
        return min(self.named, key=lambda whitening: abs(whitening.s - USUAL_ERROR))


def make_marginal_likelihood(rows: Observations, scatter: Floats) -> MarginalLikelihood:
    """The marginal likelihood of these rows; `scatter` (m, k) is B in `covariance`."""
    basis = make_basis(rows, scatter)
    return MarginalLikelihood(
        tuple(DiscrepancyWhitening(basis, s) for s in NAMED_ERRORS), tuple(DiscrepancyWhitening(basis, s) for s in UNKNOWN_ERRORS)
    )


def _integrate_scale(
    whitenings: tuple[DiscrepancyWhitening, ...], log_weights: Floats, linear: LinearModel, extra_directions: Floats | None
) -> MarginalPosterior:
    found = laplace_posteriors(linear, whitenings, extra_directions)
    logs = np.array([posterior.log_evidence for posterior in found]) + log_weights
    total = float(logsumexp(logs))
    # The posterior is never taken below the usual error, however good the fit is.
    least = next(i for i, whitening in enumerate(whitenings) if whitening.s >= USUAL_ERROR)
    at = max(int(np.argmax(logs)), least)
    error = float(np.exp(logs - total) @ np.array([whitening.s for whitening in whitenings]))
    return MarginalPosterior(total, error, found[at], whitenings[at])
