"""How much of an output's variance one sampled parameter explains alone: first-order Sobol indices, from the samples that are there.

    S_i = Var(E[y | x_i]) / Var(y)

E[y | x_i] is estimated by least squares of y on a cubic spline of x_i's share u of its range, with as many even segments as the samples
bear (n / 32, at most 12), and S_i by the adjusted coefficient of determination

    S_i = 1 - (RSS / (n - p)) / (TSS / (n - 1)),        p = segments + 3 coefficients

so that a parameter without influence has S_i = 0 on average instead of (p - 1) / (n - 1). Any independent samples serve; no scheme of
pairs of matrices is needed. The standard error is that of a bootstrap of the cases; points of a hypercube or of Sobol's sequence are
spread more evenly than those it supposes, so it is rather too large. What the S_i leave of 1 is due to interactions of parameters.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

FEWEST = 24
PER_SEGMENT = 32
MOST_SEGMENTS = 12
REPEATS = 200


@dataclass(frozen=True)
class FirstOrder:
    """S_i and its standard error."""

    index: float
    std: float


def first_order(share: Floats, y: Floats, rng: np.random.Generator) -> FirstOrder | None:
    """`share` (n,) of the parameter's range, 0 to 1, `y` (n,), NaN where there is none. None with fewer than 24 values, or all alike."""
    known = np.isfinite(y)
    share, y = share[known], y[known]
    if y.size < FEWEST or np.ptp(y) <= 1e-12 * np.abs(y).max():
        return None
    B = spline_basis(share, min(max(1, y.size // PER_SEGMENT), MOST_SEGMENTS))
    even = np.full(y.size, 1.0 / y.size)
    repeated = [_adjusted(B, y, rng.multinomial(y.size, even).astype(np.float64)) for _ in range(REPEATS)]
    return FirstOrder(_adjusted(B, y, np.ones(y.size)), float(np.std(repeated, ddof=1)))


def _adjusted(B: Floats, y: Floats, weights: Floats) -> float:
    n, p = y.size, B.shape[1]
    y = y - weights @ y / n
    weighted = B.T * weights
    coefficients, *_ = np.linalg.lstsq(weighted @ B, weighted @ y, rcond=1e-10)
    left, total = weights @ (y - B @ coefficients) ** 2, weights @ y**2
    return float(1.0 - (left / (n - p)) / (total / (n - 1)))


def spline_basis(share: Floats, segments: int) -> Floats:
    """(n, segments + 3) cubic B-splines on even segments of 0 to 1."""
    from scipy.interpolate import BSpline  # noqa: PLC0415 - grids need not pay for it

    knots = np.concatenate((np.zeros(3), np.linspace(0.0, 1.0, segments + 1), np.ones(3)))
    return np.asarray(BSpline.design_matrix(np.clip(share, 0.0, 1.0), knots, 3).toarray())
