"""Forms that the torque of a hinge over its angle may take, linear in their coefficients."""

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import BSpline

Floats = NDArray[np.float64]

CUBIC = 3


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


def spline_over(phi_rad: Floats, pieces: int) -> Spline:
    """Splines over the range of these angles, with about as many of them in each piece."""
    borders = np.quantile(phi_rad, np.linspace(0.0, 1.0, pieces + 1))
    return Spline(np.concatenate([np.full(CUBIC, borders[0]), borders, np.full(CUBIC, borders[-1])]))
