"""Marginal likelihood of the recordings under one hypothesis, with the discrepancy scale s integrated out.

The strict prior of s is half-normal with size USUAL_ERROR: nothing else is missing. With something unlisted, s is log-uniform over
UNKNOWN_ERRORS. Section 4 of docs/method.md states both.

The Laplace approximation gives posterior and evidence of a hypothesis whose model is linear near its best point. y are the measured rows, f
the model at x0 and J its Jacobian there. Then r = y - f + J x0 is normal with mean J x, and x is standard normal a priori. The
approximation holds as far as the model is linear over the width of the posterior.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.special import logsumexp

from rfca_rig.diagnosis.config import NAMED_ERRORS, UNKNOWN_ERRORS, USUAL_ERROR
from rfca_rig.diagnosis.data import Observations
from rfca_rig.diagnosis.likelihood.covariance import DiscrepancyWhitening, Whitening, make_basis

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class LinearModel:
    """The model near a point: `target` (m,) is r above and `jacobian` (m, p) is J, both in the units of the signals."""

    target: Floats
    jacobian: Floats

    def kept(self, rows: NDArray[np.bool_]) -> "LinearModel":
        """The same for some of the rows, given by a mask (m,)."""
        return LinearModel(self.target[rows], self.jacobian[rows])


@dataclass(frozen=True)
class Posterior:
    """Posterior of the unknowns x.

    Parameters
    ----------
    mean, covariance
        (p,) and (p, p), in standard normal coordinates.
    log_evidence
        Log of the density of the data under the hypothesis, without the constant with 2 pi.
    chi2
        Squared whitened residual at the mean.
    """

    mean: Floats
    covariance: Floats
    log_evidence: float
    chi2: float


def laplace_posterior(linear: LinearModel, whitening: Whitening) -> Posterior:
    """Posterior of a linear model with m rows and p unknowns, under the covariance of `whitening` (m, m)."""
    return _solve(whitening(linear.target), whitening(linear.jacobian), whitening.log_det)


def laplace_posteriors(
    linear: LinearModel, whitenings: Sequence[DiscrepancyWhitening], extra_directions: Floats | None = None
) -> list[Posterior]:
    """Posteriors of a linear model at several discrepancy scales.

    Parameters
    ----------
    linear
        The model, target (m,) and Jacobian (m, p).
    whitenings
        The scales; all must share one basis, into which the model is mapped once.
    extra_directions
        (m, k) further directions, in each of which the data may vary by one standard deviation.

    Returns
    -------
    list
        One posterior per scale.
    """
    turned = whitenings[0].basis.turned
    target, jacobian = turned(linear.target), turned(linear.jacobian)
    directions = None if extra_directions is None or not extra_directions.size else turned(extra_directions)
    found = []
    for whitening in whitenings:
        parts = whitening.scaled(target), whitening.scaled(jacobian), whitening.log_det
        found.append(_solve(*(parts if directions is None else _whiten_extra(*parts, whitening.scaled(directions)))))
    return found


def _solve(target: Floats, jacobian: Floats, log_det: float) -> Posterior:
    # The identity is the prior: every unknown is standard normal.
    precision = jacobian.T @ jacobian + np.eye(jacobian.shape[1])
    covariance = np.asarray(np.linalg.inv(precision), dtype=np.float64)
    mean = np.asarray(covariance @ (jacobian.T @ target))
    residual = target - jacobian @ mean
    chi2 = float(residual @ residual)
    sign_log = float(np.linalg.slogdet(precision)[1])
    # The terms are misfit, prior, |C| and |A|, as in section 4 of docs/method.md.
    return Posterior(mean, covariance, -0.5 * (chi2 + float(mean @ mean) + log_det + sign_log), chi2)


def _whiten_extra(target: Floats, jacobian: Floats, log_det: float, extra_directions: Floats) -> tuple[Floats, Floats, float]:
    """Whiten once more, for C + V V^T: with the SVD V = U S W^T, every direction of U shrinks by 1 / sqrt(1 + S^2)."""
    directions, size, _ = np.linalg.svd(extra_directions, full_matrices=False)
    shrink = 1.0 - 1.0 / np.sqrt(1.0 + size**2)
    target = target - directions @ (shrink * (directions.T @ target))
    jacobian = jacobian - directions @ (shrink[:, None] * (directions.T @ jacobian))
    return np.asarray(target), np.asarray(jacobian), log_det + float(np.log1p(size**2).sum())


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
