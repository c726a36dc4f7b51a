"""Bayes' rule where the model is linear near its best point (Laplace): evidence, posterior, and what leaving rows out would do.

With y measured, f the model at x0 and J its slope there, r = y - f + J x0 is normal with mean J x, and x standard normal before the data.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rfca_rig.diagnosis.likelihood.covariance import AtError, Whitening

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class LinearModel:
    """The model near a point: `target` (m,) is r above, `slope` (m, p) is J, both in the signals' units."""

    target: Floats
    jacobian: Floats

    def kept(self, rows: NDArray[np.bool_]) -> "LinearModel":
        """The same for some rows only."""
        return LinearModel(self.target[rows], self.jacobian[rows])


@dataclass(frozen=True)
class Posterior:
    """Mean (p,) and covariance (p, p) of x, and log of the density of the data under the hypothesis (without 2 pi)."""

    mean: Floats
    covariance: Floats
    log_evidence: float
    chi2: float


def laplace_posterior(linear: LinearModel, whitening: Whitening) -> Posterior:
    """The posterior under the covariance that this whitens."""
    return _solved(whitening(linear.target), whitening(linear.jacobian), whitening.log_det)


def laplace_posteriors(linear: LinearModel, whitenings: Sequence[AtError], extra_directions: Floats | None = None) -> list[Posterior]:
    """The same at several model errors of one basis.

    `extra_directions` (m, k) are further directions in which the data may vary by one standard deviation each.
    """
    turned = whitenings[0].basis.turned
    target, jacobian = turned(linear.target), turned(linear.jacobian)
    directions = None if extra_directions is None or not extra_directions.size else turned(extra_directions)
    found = []
    for whitening in whitenings:
        parts = whitening.scaled(target), whitening.scaled(jacobian), whitening.log_det
        found.append(_solved(*(parts if directions is None else _loosened(*parts, whitening.scaled(directions)))))
    return found


def _solved(target: Floats, jacobian: Floats, log_det: float) -> Posterior:
    precision = jacobian.T @ jacobian + np.eye(jacobian.shape[1])
    covariance = np.asarray(np.linalg.inv(precision), dtype=np.float64)
    mean = np.asarray(covariance @ (jacobian.T @ target))
    rest = target - jacobian @ mean
    chi2 = float(rest @ rest)
    sign_log = float(np.linalg.slogdet(precision)[1])
    return Posterior(mean, covariance, -0.5 * (chi2 + float(mean @ mean) + log_det + sign_log), chi2)


def _loosened(target: Floats, jacobian: Floats, log_det: float, extra_directions: Floats) -> tuple[Floats, Floats, float]:
    """Whitens once more, for C + V V^T: with V = U S W^T every direction of U shrinks by 1 / sqrt(1 + S^2)."""
    directions, size, _ = np.linalg.svd(extra_directions, full_matrices=False)
    shrink = 1.0 - 1.0 / np.sqrt(1.0 + size**2)
    target = target - directions @ (shrink * (directions.T @ target))
    jacobian = jacobian - directions @ (shrink[:, None] * (directions.T @ jacobian))
    return np.asarray(target), np.asarray(jacobian), log_det + float(np.log1p(size**2).sum())
