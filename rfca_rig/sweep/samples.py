"""Sample points over ranges: Latin hypercube or Sobol, from a seed that is part of the plan."""

from dataclasses import dataclass
from functools import cache
from typing import Literal

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Method = Literal["sobol", "latin hypercube"]
METHODS: tuple[Method, ...] = ("sobol", "latin hypercube")


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
