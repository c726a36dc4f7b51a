"""Numbers that a fit may move, with their priors, whatever they are the parameters of."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Generic, TypeVar

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

FARTHEST = 5.0  # standard deviations: a value beyond them says that something else is wrong
SOFTNESS = 0.3  # of a standard deviation: how roundly a value that is never negative approaches zero
S = TypeVar("S")  # what one simulation supposes, as its simulator keeps it


@dataclass(frozen=True)
class FitParameter(Generic[S]):
    """One number that a fit may move, in `unit`, the one that people write.

    `known_to` is its key in the section of that name. `relative` ones are scaled, all others shifted. `spread` is how far it may
    reasonably be off where nobody stated it, as a share of the value or in `unit`; it sets steps and bounds but pulls at nothing.
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
class Space(Generic[S]):
    """The parameters of one fit around what is supposed at first.

    A point x (p,) counts prior standard deviations, so that one step length suits all: value = centre + std x, or centre exp(std x)
    for relative ones, which keeps them positive. `std` (p,) falls back to `spread` where `has_prior` (p,) is False.
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
        """The values at x, in the parameters' units, (p,)."""
        relative = self._is_relative
        return np.where(relative, self.centres * np.exp(np.where(relative, self.std * x, 0.0)), self.centres + self.std * x)

    def point(self, name: str, value: float) -> float:
        """The coordinate at which parameter `name` has `value`."""
        i = self.names.index(name)
        centre, std = self.centres[i], self.std[i]
        return float(np.log(value / centre) / std if self.parameters[i].relative else (value - centre) / std)

    def std_in_units(self, x: Floats, std_x: Floats) -> Floats:
        """A standard deviation of x, turned into the parameters' units at x, (p,)."""
        return std_x * self.std * self._per_x(self.values(x))

    def at(self, x: Floats) -> S:
        """What is supposed at x."""
        supposed = self.centre
        for parameter, value in zip(self.parameters, self.values(x), strict=True):
            supposed = parameter.write(supposed, float(value))
        return supposed

    def bounds(self) -> tuple[Floats, Floats]:
        """Lower and upper x, each (p,)."""
        floors = [-np.inf if p.relative else (p.lowest - c) / s for p, c, s in zip(self.parameters, self.centres, self.std, strict=True)]
        return np.maximum(-FARTHEST, floors), np.full(len(self.std), FARTHEST)

    @property
    def names(self) -> tuple[str, ...]:
        return tuple(parameter.name for parameter in self.parameters)

    @property
    def _is_relative(self) -> NDArray[np.bool_]:
        return np.array([parameter.relative for parameter in self.parameters])

    def _per_x(self, values: Floats) -> Floats:
        return np.where(self._is_relative, np.abs(values), 1.0)


def never_below(nominal: float, std: float) -> Callable[[float], float]:
    """The shift that is made of a shift asked for: nearly the same where the value stays well above zero, and none takes it below.

    The positive root v of v (v - u) = w^2, for the value u asked for and w = SOFTNESS std / 2: smooth, so that it has a Jacobian.
    """
    return lambda by: 0.5 * (nominal + by + float(np.hypot(nominal + by, SOFTNESS * std))) - nominal
