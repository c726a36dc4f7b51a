"""Forms that the torque of a hinge over its angle may take, linear in their coefficients."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import BSpline, PPoly

from rfca_rig.model.torque_spline import polynomial

Floats = NDArray[np.float64]

CUBIC = 3
LEAST_KNOT_RAD = float(np.radians(0.3))  # nearer to rest no photo tells a torque: twice the usual error of an angle


class Basis(Protocol):
    """torque(phi) = sum of coefficients times columns."""

    @property
    def size(self) -> int:
        """How many coefficients."""
        ...

    def columns(self, phi_rad: Floats) -> Floats:
        """(..., size) for angles (...)."""
        ...

    def slopes(self, phi_rad: Floats) -> Floats:
        """Their derivatives by the angle, (..., size)."""
        ...


@dataclass(frozen=True)
class Hardening:
    """The model's own law, a phi + b phi^3: k0 is a, k2 is b / a."""

    size: int = 2

    def columns(self, phi_rad: Floats) -> Floats:
        return np.stack([phi_rad, phi_rad**3], axis=-1)

    def slopes(self, phi_rad: Floats) -> Floats:
        return np.stack([np.ones_like(phi_rad), 3.0 * phi_rad**2], axis=-1)


@dataclass(frozen=True)
class Spline:
    """Cubic B-splines over `knots_rad` (ascending, the ends fourfold); beyond the ends their last pieces go on.

    Every cubic is among them, so that the law is a special case, and what the splines gain over it a test of the law.
    """

    knots_rad: Floats

    @property
    def size(self) -> int:
        return len(self.knots_rad) - CUBIC - 1

    def columns(self, phi_rad: Floats) -> Floats:
        return np.asarray(BSpline(self.knots_rad, np.eye(self.size), CUBIC)(phi_rad))

    def slopes(self, phi_rad: Floats) -> Floats:
        return np.asarray(BSpline(self.knots_rad, np.eye(self.size), CUBIC).derivative()(phi_rad))


@dataclass(frozen=True)
class ThroughRest:
    """The model's own spline, whose coefficients are its torques at `knots_rad` (ascending, above 0): odd, straight beyond the last one.

    Other than `Spline` it bears no torque at rest. So rest angles are no part of it, and its coefficients go into a model as they are.
    """

    knots_rad: tuple[float, ...]

    @property
    def size(self) -> int:
        return len(self.knots_rad)

    def columns(self, phi_rad: Floats) -> Floats:
        return np.asarray(self._cardinal()(phi_rad))

    def slopes(self, phi_rad: Floats) -> Floats:
        return np.asarray(self._cardinal()(phi_rad, 1))

    def _cardinal(self) -> PPoly:
        return polynomial((0.0, *self.knots_rad), np.eye(self.size + 1)[:, 1:])


def through_rest(phi_rad: Floats, shares: Sequence[float]) -> ThroughRest:
    """The model's spline over the range of these angles from rest, with these shares of them below its knots."""
    knots = np.quantile(np.abs(phi_rad), shares)
    return ThroughRest(tuple(knots[knots > LEAST_KNOT_RAD].tolist()))


def spline_over(phi_rad: Floats, pieces: int) -> Spline:
    """Splines over the range of these angles, with about as many of them in each piece."""
    borders = np.quantile(phi_rad, np.linspace(0.0, 1.0, pieces + 1))
    return Spline(np.concatenate([np.full(CUBIC, borders[0]), borders, np.full(CUBIC, borders[-1])]))
