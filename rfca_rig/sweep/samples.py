"""Sample points over ranges, and first-order Sobol indices from samples.

Points are a Latin hypercube or Sobol's sequence, from a seed that is part of the plan.

    S_i = Var(E[y | x_i]) / Var(y)

E[y | x_i] is estimated by least squares of y on a cubic spline of x_i's share u of its range. The spline has as many even segments as the
samples allow (n / 32, at most 12). S_i is the adjusted coefficient of determination

    S_i = 1 - (RSS / (n - p)) / (TSS / (n - 1)),        p = segments + 3 coefficients

so that a parameter without influence has S_i = 0 on average instead of (p - 1) / (n - 1). Any independent samples serve; no pairs of sample
matrices are needed. The standard error comes from a bootstrap of the cases. Points of a hypercube or a Sobol sequence are more even than
the independent points of a bootstrap, so it is rather too large. The rest of 1 after all S_i is due to interactions of parameters.
"""

from dataclasses import dataclass
from functools import cache
from typing import Literal

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Method = Literal["sobol", "latin hypercube"]
METHODS: tuple[Method, ...] = ("sobol", "latin hypercube")

# Fewest values for an index, values per segment of the spline, and most segments.
MIN_VALUES = 24
PER_SEGMENT = 32
MOST_SEGMENTS = 12
# Bootstrap samples for the standard error.
BOOTSTRAP_SAMPLES = 200


@dataclass(frozen=True)
class Range:
    """Uniform from `low` to `high`, or uniform in the logarithm with `log`."""

    name: str
    low: float
    high: float
    log: bool = False


@dataclass(frozen=True)
class SweepSamples:
    """`n` points in all `ranges` together. The same seed gives the same points on any machine."""

    ranges: tuple[Range, ...]
    method: Method
    n: int
    seed: int

    @property
    def names(self) -> tuple[str, ...]:
        return tuple(each.name for each in self.ranges)


def why_unbalanced(method: Method, n: int) -> str | None:
    """Why a Sobol sequence should not be cut off after `n` points, or None."""
    # A power of 2 has exactly one bit.
    if method != "sobol" or n.bit_count() == 1:
        return None
    below = 1 << (n.bit_length() - 1)
    return f"n = {n}: Sobol points are balanced in powers of two only; take {below} or {2 * below}, or a latin hypercube"


@cache
def points(samples: SweepSamples) -> Floats:
    """Sample points (n, ranges), in the units of their quantities."""
    unit = shares(samples)
    columns = [_between(each, unit[:, place]) for place, each in enumerate(samples.ranges)]
    return np.stack(columns, axis=1)


@cache
def shares(samples: SweepSamples) -> Floats:
    """Sample points (n, ranges) as shares of each range, from 0 to 1, as they are drawn."""
    from scipy.stats import qmc  # noqa: PLC0415 - grids need not pay for it

    dimensions, rng = len(samples.ranges), np.random.default_rng(samples.seed)
    # Both kinds are randomised by the seeded generator; scipy scrambles Sobol points by default.
    kind = qmc.Sobol if samples.method == "sobol" else qmc.LatinHypercube
    return np.asarray(kind(dimensions, seed=rng).random(samples.n))


def _between(over: Range, share: Floats) -> Floats:
    if over.log:
        return np.asarray(np.exp(np.log(over.low) + share * (np.log(over.high) - np.log(over.low))))
    return over.low + share * (over.high - over.low)


@dataclass(frozen=True)
class FirstOrder:
    """First-order index S_i and its standard error."""

    index: float
    std: float


def first_order(share: Floats, y: Floats, rng: np.random.Generator) -> FirstOrder | None:
    """First-order index of one parameter; None with fewer than 24 values, or if all are equal.

    Parameters
    ----------
    share : (n,) parameter values as shares of its range, 0 to 1
    y : (n,) output, NaN where there is none
    rng : random numbers of the bootstrap
    """
    known = np.isfinite(y)
    share, y = share[known], y[known]
    if y.size < MIN_VALUES or np.ptp(y) <= 1e-12 * np.abs(y).max():
        return None
    B = spline_basis(share, min(max(1, y.size // PER_SEGMENT), MOST_SEGMENTS))
    even = np.full(y.size, 1.0 / y.size)
    # Drawing n cases with replacement is the same as multinomial weights on them.
    repeated = [_r2_adjusted(B, y, rng.multinomial(y.size, even).astype(np.float64)) for _ in range(BOOTSTRAP_SAMPLES)]
    return FirstOrder(_r2_adjusted(B, y, np.ones(y.size)), float(np.std(repeated, ddof=1)))


def _r2_adjusted(B: Floats, y: Floats, weights: Floats) -> float:
    n, p = y.size, B.shape[1]
    # The total sum of squares is about the weighted mean; the fit does not change, because the splines contain the constant.
    y = y - weights @ y / n
    weighted = B.T * weights
    coefficients, *_ = np.linalg.lstsq(weighted @ B, weighted @ y, rcond=1e-10)
    left, total = weights @ (y - B @ coefficients) ** 2, weights @ y**2
    return float(1.0 - (left / (n - p)) / (total / (n - 1)))


def spline_basis(share: Floats, segments: int) -> Floats:
    """Cubic B-splines (n, segments + 3) of the shares (n,) on even segments of 0 to 1."""
    from scipy.interpolate import BSpline  # noqa: PLC0415 - grids need not pay for it

    knots = np.concatenate((np.zeros(3), np.linspace(0.0, 1.0, segments + 1), np.ones(3)))
    return np.asarray(BSpline.design_matrix(np.clip(share, 0.0, 1.0), knots, 3).toarray())
