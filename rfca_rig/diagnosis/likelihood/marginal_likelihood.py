"""Marginal likelihood of the recordings under one hypothesis, with the discrepancy scale s
integrated out.

The strict prior of s is half-normal with size USUAL_ERROR: nothing else is missing. With something
unlisted, s is log-uniform over UNKNOWN_ERRORS. Section 4 of docs/method.md states both.

The Laplace approximation gives posterior and evidence of a hypothesis whose model is linear near
its best point. y are the measured rows, f the model at x0 and J its Jacobian there. Then r = y - f
+ J x0 is normal with mean J x, and x is standard normal a priori. The approximation holds as far as
the model is linear over the width of the posterior.

Held-out prediction: each condition is predicted from all others, without a new fit per condition. P
is the inverse covariance of all rows, and o are the rows of the held-out condition. Given all other
rows, the rows o are normal with precision P_oo. So the information of the other rows is J^T P J -
(P J)_o^T P_oo^-1 (P J)_o, and only P is needed.
"""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cho_factor, cho_solve, cholesky, solve_triangular
from scipy.special import logsumexp

from rfca_rig.diagnosis.config import NAMED_ERRORS, UNKNOWN_ERRORS, USUAL_ERROR
from rfca_rig.diagnosis.data import Observations
from rfca_rig.diagnosis.likelihood.covariance import DiscrepancyWhitening, Whitening, make_basis

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class LinearModel:
    """The model near a point: `target` (m,) is r above and `jacobian` (m, p) is J, both in the
    units of the signals.
    """

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
    """Posterior of a linear model with m rows and p unknowns, under the covariance of
    `whitening` (m, m).
    """
    return _solve(whitening(linear.target), whitening(linear.jacobian), whitening.log_det)


def laplace_posteriors(
    linear: LinearModel, whitenings: Sequence[DiscrepancyWhitening]
) -> list[Posterior]:
    """Posteriors of a linear model at several discrepancy scales.

    Parameters
    ----------
    linear
        The model, target (m,) and Jacobian (m, p).
    whitenings
        The scales; all must share one basis, into which the model is mapped once.

    Returns
    -------
    list
        One posterior per scale.
    """
    turned = whitenings[0].basis.turned
    target = turned(linear.target)
    jacobian = turned(linear.jacobian)
    posteriors = []
    for whitening in whitenings:
        white_target = whitening.scaled(target)
        white_jacobian = whitening.scaled(jacobian)
        posteriors.append(_solve(white_target, white_jacobian, whitening.log_det))
    return posteriors


def _solve(target: Floats, jacobian: Floats, log_det: float) -> Posterior:
    # The identity is the prior: every unknown is standard normal.
    precision = jacobian.T @ jacobian + np.eye(jacobian.shape[1])
    covariance = np.asarray(np.linalg.inv(precision), dtype=np.float64)
    mean = np.asarray(covariance @ (jacobian.T @ target))
    residual = target - jacobian @ mean
    chi2 = float(residual @ residual)
    log_det_precision = float(np.linalg.slogdet(precision)[1])
    # The terms are misfit, prior, |C| and |A|, as in section 4 of docs/method.md.
    log_evidence = -0.5 * (chi2 + float(mean @ mean) + log_det + log_det_precision)
    return Posterior(mean, covariance, log_evidence, chi2)


@dataclass(frozen=True)
class MarginalPosterior:
    """Log evidence, mean discrepancy scale `error`, and posterior of the unknowns.

    The posterior is the one at the most probable s, but at least at the usual one. A fit that
    happens to be better than usual is no reason for a narrower interval.
    """

    log_evidence: float
    error: float
    posterior: Posterior
    whitening: DiscrepancyWhitening

    def max_nuisance_shift(self, nuisances: int) -> float:
        """Largest distance of a nuisance parameter from its prior mean, in prior standard
        deviations.
        """
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

    def evaluate(self, linear: LinearModel) -> MarginalPosterior:
        """Evidence and posterior if nothing else is missing."""
        # The grid is uneven, so each point has the width that it stands for as a weight.
        half_normal = (
            np.log(np.gradient(NAMED_ERRORS)) - 0.5 * (np.array(NAMED_ERRORS) / USUAL_ERROR) ** 2
        )
        return _integrate_scale(self.named, half_normal - logsumexp(half_normal), linear)

    def evaluate_unknown(self, linear: LinearModel) -> MarginalPosterior:
        """Evidence and posterior if something unlisted is missing beside the hypothesis."""
        log_uniform = np.full(len(self.unknown), -np.log(len(self.unknown)))
        return _integrate_scale(self.unknown, log_uniform, linear)

    def level(self, linear: LinearModel) -> DiscrepancyWhitening:
        """The whitening at the most probable scale, the usual one at least: it reflects the
        actual misfit of this linear model.
        """
        # Both grids contain the scale where they meet, hence [1:].
        candidates = [
            whitening
            for whitening in (*self.named, *self.unknown[1:])
            if whitening.s >= USUAL_ERROR
        ]
        posteriors = laplace_posteriors(linear, candidates)
        log_evidences = [posterior.log_evidence for posterior in posteriors]
        return candidates[int(np.argmax(log_evidences))]

    def compute_held_out_residuals(
        self, linear: LinearModel, condition: NDArray[np.intp], left_out: Iterable[int]
    ) -> Floats:
        """`loo_residuals` (m,) of a hypothesis at its own most probable scale, the usual one at
        least.
        """
        return loo_residuals(linear, self.level(linear), condition, left_out)

    @cached_property
    def every_scale(self) -> tuple[DiscrepancyWhitening, ...]:
        """The whitenings at all discrepancy scales of the grid, ascending."""
        by_scale = {whitening.s: whitening for whitening in (*self.unknown, *self.named)}
        return tuple(by_scale[s] for s in sorted(by_scale))

    @property
    def usual(self) -> DiscrepancyWhitening:
        """The whitening at the usual model error."""
        return min(self.named, key=lambda whitening: abs(whitening.s - USUAL_ERROR))


def make_marginal_likelihood(rows: Observations, scatter: Floats) -> MarginalLikelihood:
    """The marginal likelihood of these rows; `scatter` (m, k) is B in `covariance`."""
    basis = make_basis(rows, scatter)
    return MarginalLikelihood(
        tuple(DiscrepancyWhitening(basis, s) for s in NAMED_ERRORS),
        tuple(DiscrepancyWhitening(basis, s) for s in UNKNOWN_ERRORS),
    )


def _integrate_scale(
    whitenings: tuple[DiscrepancyWhitening, ...], log_weights: Floats, linear: LinearModel
) -> MarginalPosterior:
    posteriors = laplace_posteriors(linear, whitenings)
    scales = np.array([whitening.s for whitening in whitenings])
    log_joint = np.array([posterior.log_evidence for posterior in posteriors]) + log_weights
    log_evidence = float(logsumexp(log_joint))
    mean_scale = float(np.exp(log_joint - log_evidence) @ scales)
    # The posterior is never taken below the usual error, however good the fit is.
    usual = next(i for i, s in enumerate(scales) if s >= USUAL_ERROR)
    most_probable = max(int(np.argmax(log_joint)), usual)
    return MarginalPosterior(
        log_evidence, mean_scale, posteriors[most_probable], whitenings[most_probable]
    )


def loo_residuals(
    linear: LinearModel,
    whitening: DiscrepancyWhitening,
    condition: NDArray[np.intp],
    left_out: Iterable[int],
) -> Floats:
    """Residuals (m,) on held-out conditions: measured less predicted, in the units of the signals.

    Parameters
    ----------
    linear
        The hypothesis near its best point.
    whitening
        The covariance, at one discrepancy scale.
    condition
        (m,) the condition of each row.
    left_out
        The conditions that are held out, each predicted from all other rows. Rows of other
        conditions are 0.

    Returns
    -------
    (m,)
        Each prediction uses the parameters that fit the other conditions, but not their
        discrepancy.
    """
    residuals = np.zeros(len(linear.target))
    numbers = list(left_out)
    means = loo_estimates(linear, whitening, condition, numbers)
    for number, mean in zip(numbers, means, strict=True):
        out = condition == number
        residuals[out] = linear.target[out] - linear.jacobian[out] @ mean
    return residuals


def loo_estimates(
    linear: LinearModel,
    whitening: DiscrepancyWhitening,
    condition: NDArray[np.intp],
    left_out: Iterable[int],
) -> Floats:
    """Posterior means of the unknowns (conditions, p), each from all rows but those of one
    condition of `left_out`.
    """
    means = [mean for mean, _ in loo_posteriors(linear, whitening, condition, left_out)]
    return np.array(means).reshape(len(means), linear.jacobian.shape[1])


def loo_posteriors(
    linear: LinearModel,
    whitening: DiscrepancyWhitening,
    condition: NDArray[np.intp],
    left_out: Iterable[int],
) -> Iterator[tuple[Floats, Floats]]:
    """Posterior mean (p,) and precision (p, p) of the unknowns from all rows but those of one
    condition, for each of `left_out`.
    """
    # Jacobian and target side by side: one product with C^-1 gives both sides of the normal
    # equations.
    both = np.column_stack([linear.jacobian, linear.target])
    unknowns = linear.jacobian.shape[1]
    weighted = whitening.apply_precision(both)
    for number in left_out:
        products, _ = products_without(both, weighted, whitening, condition == number)
        # The identity is the prior: every unknown is standard normal.
        precision = products[:unknowns, :unknowns] + np.eye(unknowns)
        mean = np.linalg.solve(precision, products[:unknowns, unknowns])
        yield np.asarray(mean), np.asarray(precision)


def jackknife_std(
    linear: LinearModel, whitening: DiscrepancyWhitening, condition: NDArray[np.intp]
) -> Floats:
    """Standard deviations of all unknowns by leaving one condition out at a time, (p,); 0 with
    fewer than three conditions.

    Parameters
    ----------
    linear
        The hypothesis near its best point.
    whitening
        At the discrepancy scale of the hypothesis.
    condition
        (m,) the condition of each row.

    References
    ----------
    Quenouille, Biometrika 43 (1956) 353.
    """
    count = int(condition.max()) + 1
    # With two conditions, one is held out and only one is left: their difference says little.
    if count < 3:
        return np.zeros(linear.jacobian.shape[1])
    means = loo_estimates(linear, whitening, condition, range(count))
    # Delete-one jackknife: (n - 1) / n times the sum of squared deviations from the mean.
    return np.asarray(np.sqrt((count - 1) * np.var(means, axis=0)))


def loo_log_densities(
    linear: LinearModel,
    whitening: DiscrepancyWhitening,
    condition: NDArray[np.intp],
    left_out: Iterable[int],
) -> Floats:
    """Log predictive density of the rows of each condition given all other rows, (conditions,);
    0 for conditions not in `left_out`.
    """
    both = np.column_stack([linear.jacobian, linear.target])
    log_2pi = float(np.log(2.0 * np.pi))
    weighted = whitening.apply_precision(both)
    # log p(y_o | y_rest) = log p(y) - log p(y_rest). The constant with 2 pi counts only the rows of
    # the condition.
    of_all = _log_evidence(both.T @ weighted, whitening.log_det)
    log_densities = np.zeros(int(condition.max()) + 1)
    for number in left_out:
        out = condition == number
        of_others = _log_evidence(*products_without(both, weighted, whitening, out))
        log_densities[number] = of_all - of_others - 0.5 * int(out.sum()) * log_2pi
    return log_densities


def _log_evidence(products: Floats, log_det: float) -> float:
    """Log density (without 2 pi) of rows with these products of columns and target; the unknowns
    are standard normal a priori.
    """
    # `products` is [[J^T P J, J^T P y], [y^T P J, y^T P y]].
    factor = cholesky(
        products[:-1, :-1] + np.eye(len(products) - 1), lower=True, check_finite=False
    )
    match = solve_triangular(factor, products[:-1, -1], lower=True, check_finite=False)
    misfit = float(match @ match - products[-1, -1] - log_det)
    return 0.5 * misfit - float(np.log(np.diag(factor)).sum())


def products_without(
    both: Floats, weighted: Floats, whitening: DiscrepancyWhitening, out: NDArray[np.bool_]
) -> tuple[Floats, float]:
    """Products of columns under the covariance of all rows except `out`.

    Parameters
    ----------
    both
        (m, k) the columns.
    weighted
        (m, k) the same times the inverse covariance of all rows.
    whitening
        The covariance of all rows.
    out
        (m,) which rows are left out.

    Returns
    -------
    (k, k), float
        The products, and the log of the determinant of the covariance of the remaining rows.
    """
    factor = cho_factor(whitening.precision(out), check_finite=False)
    taken = weighted[out].T @ cho_solve(factor, weighted[out], check_finite=False)
    # log|C_rest| = log|C| + log|P_oo|
    log_det = whitening.log_det + 2.0 * float(np.log(np.diag(factor[0])).sum())
    return both.T @ weighted - taken, log_det
