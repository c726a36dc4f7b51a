"""Laplace approximation: posterior and evidence of a hypothesis whose model is linear near its best point.

y are the measured rows, f the model at x0 and J its Jacobian there. Then r = y - f + J x0 is normal with mean J x, and x is standard normal
a priori. The approximation holds as far as the model is linear over the width of the posterior.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rfca_rig.diagnosis.likelihood.covariance import DiscrepancyWhitening, Whitening

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
