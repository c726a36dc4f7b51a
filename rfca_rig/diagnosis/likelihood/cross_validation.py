"""Held-out prediction: each condition predicted from all others, without a new fit per condition.

P is the inverse covariance of all rows, and o are the rows of the held-out condition. Given all other rows, the rows o are normal with
precision P_oo. So the information of the other rows is J^T P J - (P J)_o^T P_oo^-1 (P J)_o, and only P is needed.
"""

from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cho_factor, cho_solve, cholesky, solve_triangular

from rfca_rig.diagnosis.likelihood.covariance import DiscrepancyWhitening
from rfca_rig.diagnosis.likelihood.marginal_likelihood import LinearModel

Floats = NDArray[np.float64]


def loo_residuals(linear: LinearModel, whitening: DiscrepancyWhitening, condition: NDArray[np.intp], left_out: Iterable[int]) -> Floats:
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
        The conditions that are held out, each predicted from all other rows. Rows of other conditions are 0.

    Returns
    -------
    (m,)
        Each prediction uses the parameters that fit the other conditions, but not their discrepancy.
    """
    apart = np.zeros(len(linear.target))
    numbers = list(left_out)
    for number, mean in zip(numbers, loo_estimates(linear, whitening, condition, numbers), strict=True):
        out = condition == number
        apart[out] = linear.target[out] - linear.jacobian[out] @ mean
    return apart


def loo_estimates(linear: LinearModel, whitening: DiscrepancyWhitening, condition: NDArray[np.intp], left_out: Iterable[int]) -> Floats:
    """Posterior means of the unknowns (conditions, p), each from all rows but those of one condition of `left_out`."""
    # Jacobian and target side by side: one product with C^-1 gives both sides of the normal equations.
    both, unknowns = np.column_stack([linear.jacobian, linear.target]), linear.jacobian.shape[1]
    weighted = whitening.apply_precision(both)
    means = []
    for number in left_out:
        others, _ = products_without(both, weighted, whitening, condition == number)
        # The identity is the prior: every unknown is standard normal.
        means.append(np.linalg.solve(others[:unknowns, :unknowns] + np.eye(unknowns), others[:unknowns, unknowns]))
    return np.array(means).reshape(len(means), unknowns)


def jackknife_std(linear: LinearModel, whitening: DiscrepancyWhitening, condition: NDArray[np.intp]) -> Floats:
    """Standard deviations of all unknowns by leaving one condition out at a time, (p,); 0 with fewer than three conditions.

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


def loo_log_densities(linear: LinearModel, whitening: DiscrepancyWhitening, condition: NDArray[np.intp], left_out: Iterable[int]) -> Floats:
    """Log predictive density of the rows of each condition given all other rows, (conditions,); 0 for conditions not in `left_out`."""
    both, log_2pi = np.column_stack([linear.jacobian, linear.target]), float(np.log(2.0 * np.pi))
    weighted = whitening.apply_precision(both)
    # log p(y_o | y_rest) = log p(y) - log p(y_rest). The constant with 2 pi counts only the rows of the condition.
    everything = _log_evidence(both.T @ weighted, whitening.log_det)
    found = np.zeros(int(condition.max()) + 1)
    for number in left_out:
        out = condition == number
        others = _log_evidence(*products_without(both, weighted, whitening, out))
        found[number] = everything - others - 0.5 * int(out.sum()) * log_2pi
    return found


def _log_evidence(products: Floats, log_det: float) -> float:
    """Log density (without 2 pi) of rows with these products of columns and target; the unknowns are standard normal a priori."""
    # `products` is [[J^T P J, J^T P y], [y^T P J, y^T P y]].
    factor = cholesky(products[:-1, :-1] + np.eye(len(products) - 1), lower=True, check_finite=False)
    match = solve_triangular(factor, products[:-1, -1], lower=True, check_finite=False)
    return 0.5 * float(match @ match - products[-1, -1] - log_det) - float(np.log(np.diag(factor)).sum())


def products_without(both: Floats, weighted: Floats, whitening: DiscrepancyWhitening, out: NDArray[np.bool_]) -> tuple[Floats, float]:
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
    own = cho_factor(whitening.precision(out), check_finite=False)
    taken = weighted[out].T @ cho_solve(own, weighted[out], check_finite=False)
    # log|C_rest| = log|C| + log|P_oo|
    return both.T @ weighted - taken, whitening.log_det + 2.0 * float(np.log(np.diag(own[0])).sum())
