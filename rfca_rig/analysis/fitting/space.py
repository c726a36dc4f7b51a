"""Parameter space of a fit, with priors, independent of what the parameters belong to."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Generic, TypeVar

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

# Bound in standard deviations: a value beyond it means that something else is wrong.
MAX_SHIFT_STD = 5.0
# Share of a standard deviation over which a value that is never negative is rounded towards zero.
ZERO_ROUNDING = 0.3
# The values of one simulation, in the type of its simulator.
S = TypeVar("S")


@dataclass(frozen=True)
class FitParameter(Generic[S]):
    """One number that a fit may change, in `unit`, the unit of the files.

    `known_to` is its key in the section of that name. `relative` parameters are scaled, all others
    shifted. `spread` is how far it may plausibly be off where no prior is stated, as a share of the
    value or in `unit`. It sets steps and bounds but is no prior.
    """

    name: str
    unit: str
    relative: bool
    spread: float
    read: Callable[[S], float]
    write: Callable[[S, float], S]
    known_to: str | None = None
    lowest: float = -np.inf


@dataclass(frozen=True)
class Prior(Generic[S]):
    """The parameters of one fit around a first point.

    A point x (p,) counts prior standard deviations, so that one step length suits all. The value is
    centre + std x, or centre exp(std x) for relative parameters, which keeps them positive. `std`
    (p,) falls back to `spread` where `has_prior` (p,) is False.
    """

    parameters: tuple[FitParameter[S], ...]
    centre: S
    std: Floats
    has_prior: NDArray[np.bool_]

    @property
    def centres(self) -> Floats:
        """The values at x = 0, in the parameters' units, (p,)."""
        return np.array([parameter.read(self.centre) for parameter in self.parameters])

    @property
    def prior_std(self) -> Floats:
        """The prior's standard deviations in the parameters' units, (p,)."""
        return self.std * self._per_x(self.centres)

    def values(self, x: Floats) -> Floats:
        """The values at x, (p,), in the parameters' units."""
        # np.where evaluates both branches: without the inner one, exp could overflow for parameters
        # that are not relative.
        relative = self._is_relative
        return np.where(
            relative,
            self.centres * np.exp(np.where(relative, self.std * x, 0.0)),
            self.centres + self.std * x,
        )

    def clip(self, x: Floats) -> Floats:
        """The point x (p,) with every value raised to its lowest possible one.

        A search without bounds may pass them: beyond, slopes stay those of the values inside, where
        clipped values would have none.
        """
        return np.maximum(x, (self._lowest - self.centres) / self.std)

    def point(self, name: str, value: float) -> float:
        """The coordinate x at which parameter `name` has `value`."""
        i = self.names.index(name)
        centre = self.centres[i]
        std = self.std[i]
        # Inverse of `values`.
        if self.parameters[i].relative:
            return float(np.log(value / centre) / std)
        return float((value - centre) / std)

    def std_in_units(self, x: Floats, std_x: Floats) -> Floats:
        """Standard deviations of x (p,), converted to the parameters' units at x, (p,)."""
        return std_x * self.std * self._per_x(self.values(x))

    def at(self, x: Floats) -> S:
        """The simulation's values at x (p,)."""
        supposed = self.centre
        for parameter, value in zip(self.parameters, self.values(x), strict=True):
            supposed = parameter.write(supposed, float(value))
        return supposed

    def bounds(self) -> tuple[Floats, Floats]:
        """Lower and upper x, each (p,)."""
        return np.maximum(-MAX_SHIFT_STD, (self._lowest - self.centres) / self.std), np.full(
            len(self.std), MAX_SHIFT_STD
        )

    @property
    def names(self) -> tuple[str, ...]:
        return tuple(parameter.name for parameter in self.parameters)

    @property
    def _is_relative(self) -> NDArray[np.bool_]:
        return np.array([parameter.relative for parameter in self.parameters])

    @property
    def _lowest(self) -> Floats:
        # Relative parameters are positive anyway; a limit applies to shifted ones alone.
        return np.array(
            [-np.inf if parameter.relative else parameter.lowest for parameter in self.parameters]
        )

    def _per_x(self, values: Floats) -> Floats:
        return np.where(self._is_relative, np.abs(values), 1.0)


def never_below(nominal: float, std: float) -> Callable[[float], float]:
    """Maps a requested shift of `nominal` to a smooth one that never takes the value below zero.

    Well above zero both shifts are nearly equal. The value is the positive root v of v (v - u) =
    w^2, for the requested value u and w = ZERO_ROUNDING std / 2. It is smooth, so that it has a
    Jacobian.
    """
    return lambda by: (
        0.5 * (nominal + by + float(np.hypot(nominal + by, ZERO_ROUNDING * std))) - nominal
    )
