"""Parameter space of a fit, with priors, independent of what the parameters belong to."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
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
class JointNormal:
    """A joint normal distribution of the deviations z of all parameters from the centre of a prior.

    Parameters
    ----------
    mean
        (p,) in units of the prior's `std`.
    covariance
        (p, p) in the square of these units, positive definite.
    """

    mean: Floats
    covariance: Floats

    @cached_property
    def std(self) -> Floats:
        """Standard deviations (p,)."""
        return np.asarray(np.sqrt(np.diag(self.covariance)))

    @cached_property
    def correlation_root(self) -> Floats:
        """Symmetric root (p, p) of the correlation matrix.

        With it, each standard normal coordinate is as close as possible to the parameter whose
        number it has (ZCA-cor whitening: Kessy et al., Am. Stat. 72 (2018) 309), so that it may
        bear that parameter's name.
        """
        correlation = self.covariance / np.outer(self.std, self.std)
        squares, vectors = np.linalg.eigh(correlation)
        # Rounding may make an eigenvalue of strongly correlated parameters slightly negative.
        sizes = np.sqrt(np.maximum(squares, 1e-12))
        return np.asarray((vectors * sizes) @ vectors.T)


@dataclass(frozen=True)
class Prior(Generic[S]):
    """The parameters of one fit around a first point.

    A point x (p,) is standard normal a priori, so that one step length suits all. z (p,) are the
    deviations from the centre in units of `std`: the value is centre + std z, or centre exp(std z)
    for relative parameters, which keeps them positive. z is x itself where the parameters are
    independent; with a `joint` distribution `deviations` maps x to z. `std` (p,) falls back to
    `spread` where `has_prior` (p,) is False.
    """

    parameters: tuple[FitParameter[S], ...]
    centre: S
    std: Floats
    has_prior: NDArray[np.bool_]
    joint: JointNormal | None = None

    @property
    def centres(self) -> Floats:
        """The values at x = 0, in the parameters' units, (p,)."""
        return self.values(np.zeros(len(self.std)))

    @property
    def prior_std(self) -> Floats:
        """The prior's standard deviations in the parameters' units, (p,)."""
        std = self.std if self.joint is None else self.std * self.joint.std
        return std * self._per_x(self.centres)

    def deviations(self, x: Floats) -> Floats:
        """z (p,) at x (p,)."""
        if self.joint is None:
            return x
        return self.joint.mean + self.joint.std * self.prior_shifts(x)

    def prior_shifts(self, x: Floats) -> Floats:
        """Distance (p,) of each parameter from its prior mean in its own prior standard deviations,
        at x (p,).
        """
        if self.joint is None:
            return x
        return np.asarray(self.joint.correlation_root @ x)

    def per_deviation(self, jacobian: Floats) -> Floats:
        """Derivatives (m, p) with respect to z, from those with respect to x."""
        if self.joint is None:
            return jacobian
        solved = np.linalg.solve(self.joint.correlation_root, jacobian.T)
        return np.asarray(solved.T / self.joint.std)

    def per_coordinate(self, jacobian: Floats) -> Floats:
        """Derivatives (m, p) with respect to x, from those with respect to z."""
        if self.joint is None:
            return jacobian
        return np.asarray((jacobian * self.joint.std) @ self.joint.correlation_root)

    def values(self, x: Floats) -> Floats:
        """The values at x, (p,), in the parameters' units."""
        # np.where evaluates both branches: without the inner one, exp could overflow for parameters
        # that are not relative.
        relative = self._is_relative
        shift = self.std * self.deviations(x)
        return np.where(
            relative,
            self._nominal * np.exp(np.where(relative, shift, 0.0)),
            self._nominal + shift,
        )

    def clip(self, x: Floats) -> Floats:
        """The point x (p,) with every value raised to its lowest possible one.

        A search without bounds may pass them: beyond, slopes stay those of the values inside, where
        clipped values would have none.
        """
        lowest = (self._lowest - self._nominal) / self.std
        if self.joint is None:
            return np.maximum(x, lowest)
        z = np.maximum(self.deviations(x), lowest)
        shifts = (z - self.joint.mean) / self.joint.std
        return np.asarray(np.linalg.solve(self.joint.correlation_root, shifts))

    def point(self, name: str, value: float) -> float:
        """The deviation z at which parameter `name` has `value`: its coordinate x where the
        parameters are independent.
        """
        i = self.names.index(name)
        nominal = self._nominal[i]
        std = self.std[i]
        # Inverse of `values`.
        if self.parameters[i].relative:
            return float(np.log(value / nominal) / std)
        return float((value - nominal) / std)

    def std_in_units(self, x: Floats, covariance: Floats) -> Floats:
        """Standard deviations (p,) in the parameters' units of x (p,) with covariance (p, p)."""
        if self.joint is None:
            std_z = np.sqrt(np.diag(covariance))
        else:
            root = self.joint.correlation_root
            std_z = self.joint.std * np.sqrt(np.diag(root @ covariance @ root))
        return np.asarray(std_z * self.std * self._per_x(self.values(x)))

    def at(self, x: Floats) -> S:
        """The simulation's values at x (p,)."""
        supposed = self.centre
        for parameter, value in zip(self.parameters, self.values(x), strict=True):
            supposed = parameter.write(supposed, float(value))
        return supposed

    def bounds(self) -> tuple[Floats, Floats]:
        """Lower and upper x, each (p,)."""
        return np.maximum(-MAX_SHIFT_STD, (self._lowest - self._nominal) / self.std), np.full(
            len(self.std), MAX_SHIFT_STD
        )

    @property
    def names(self) -> tuple[str, ...]:
        return tuple(parameter.name for parameter in self.parameters)

    @property
    def _nominal(self) -> Floats:
        """The values at z = 0, in the parameters' units, (p,)."""
        return np.array([parameter.read(self.centre) for parameter in self.parameters])

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
