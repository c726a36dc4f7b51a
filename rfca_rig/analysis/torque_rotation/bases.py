"""Forms of the torque of a hinge over its angle, linear in their coefficients, and a fitted
curve with its uncertainty.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import BSpline, PPoly
from scipy.stats import t as student

from rfca_rig.model.hinge_springs import polynomial

Floats = NDArray[np.float64]

CUBIC = 3
# Twice the usual error of an angle: closer to rest no photo determines a torque.
LEAST_KNOT_RAD = float(np.radians(0.3))

CONFIDENCE = 0.95


class Basis(Protocol):
    """torque(phi) = sum of coefficients times columns. Columns are (m, size) for angles (m,) in
    rad, and alike for more axes.
    """

    @property
    def size(self) -> int:
        """Number of coefficients."""
        ...

    def columns(self, phi_rad: Floats) -> Floats:
        """Columns (..., size) for angles (...)."""
        ...

    def slopes(self, phi_rad: Floats) -> Floats:
        """Derivatives of the columns by the angle, (..., size)."""
        ...


@dataclass(frozen=True)
class Hardening:
    """The model's own law, a phi + b phi^3, with columns (m, 2): k0 is a, k2 is b / a."""

    size: int = 2

    def columns(self, phi_rad: Floats) -> Floats:
        return np.stack([phi_rad, phi_rad**3], axis=-1)

    def slopes(self, phi_rad: Floats) -> Floats:
        return np.stack([np.ones_like(phi_rad), 3.0 * phi_rad**2], axis=-1)


@dataclass(frozen=True)
class Spline:
    """Cubic B-splines over `knots_rad` (k,), ascending with the ends fourfold; columns (..., k -
    4). The end pieces extend beyond the ends.

    Every cubic is among them. The law is therefore a special case, and the gain of the splines over
    it tests the law.
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
class SplineThroughRest:
    """The model's own spline: its coefficients are its torques at `knots_rad` (ascending, above 0).
    It is odd, and straight beyond the last knot.

    Columns are (..., size). Unlike `Spline` it bears no torque at rest. Rest angles are therefore
    no part of it, and its coefficients go into a model as they are.
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
        # Cardinal splines: each is 1 at its own knot and 0 at all others. The one at rest is
        # dropped.
        return polynomial((0.0, *self.knots_rad), np.eye(self.size + 1)[:, 1:])


def make_spline_through_rest(phi_rad: Floats, shares: Sequence[float]) -> SplineThroughRest:
    """The model's spline over the range of angles (m,) from rest, with knots at these quantiles
    of their magnitudes.
    """
    knots = np.quantile(np.abs(phi_rad), shares)
    # Knots near rest are dropped: no photo determines a torque there, and the curve is zero at rest
    # anyway.
    return SplineThroughRest(tuple(knots[knots > LEAST_KNOT_RAD].tolist()))


def make_spline(phi_rad: Floats, pieces: int) -> Spline:
    """Splines over the range of angles (m,), with about equally many angles in each piece."""
    borders = np.quantile(phi_rad, np.linspace(0.0, 1.0, pieces + 1))
    return Spline(
        np.concatenate([np.full(CUBIC, borders[0]), borders, np.full(CUBIC, borders[-1])])
    )


@dataclass(frozen=True)
class TorqueCurve:
    """Torque of a hinge over its angle: coefficients (size,) of a basis with covariance (size,
    size), valid over `range_rad`.

    `freedom` is the number of degrees of freedom. `bends` is the sign of most angles; multiplied by
    it, the curve has bending positive.
    """

    basis: Basis
    coefficients: Floats
    covariance: Floats
    range_rad: tuple[float, float]
    bends: float
    freedom: int

    @property
    def reach(self) -> float:
        """Half width of the 95 % band in standard deviations."""
        return float(student.ppf(0.5 + 0.5 * CONFIDENCE, max(self.freedom, 1)))

    def torque_Nm(self, phi_rad: Floats) -> tuple[Floats, Floats]:
        """Torque (m,) and its standard deviation (m,) at angles (m,)."""
        return self._of(self.basis.columns(phi_rad))

    def stiffness_Nm_per_rad(self, phi_rad: Floats) -> tuple[Floats, Floats]:
        """Equivalent stiffness (m,), the derivative of the torque, and its standard deviation
        (m,), at angles (m,).
        """
        return self._of(self.basis.slopes(phi_rad))

    def grid_rad(self, count: int = 101) -> Floats:
        """Angles (count,) over the range, from the least bent on."""
        low, high = self.range_rad
        if self.bends > 0:
            return np.linspace(low, high, count)
        return np.linspace(high, low, count)

    def _of(self, columns: Floats) -> tuple[Floats, Floats]:
        variance = np.einsum("mi,ij,mj->m", columns, self.covariance, columns)
        return columns @ self.coefficients, np.sqrt(np.maximum(variance, 0.0))


@dataclass(frozen=True)
class LawValues:
    """k0 and k2 of the law k0 (phi + k2 phi^3), one standard deviation each, their correlation, and
    the half width of 95 % in deviations.

    k0 is the stiffness at rest, and k2 the hardening from there to the largest angle: the law has
    the true torque at that angle. The deviations hold how far the true curve may be from the law.
    """

    k0_Nm_per_rad: float
    k0_std: float
    k2_per_rad2: float
    k2_std: float
    correlation: float
    reach: float

    @property
    def known_to(self) -> dict[str, float]:
        """As keys of the section [known_to]."""
        return {
            "k0_relative": self.k0_std / self.k0_Nm_per_rad,
            "k2_relative": self.k2_std / abs(self.k2_per_rad2),
        }


def law_values(curve: TorqueCurve) -> LawValues:
    """k0 and k2 of a curve, from its stiffness at rest and its torque at the largest angle."""
    phi = max(curve.range_rad, key=abs)
    rows = np.stack([curve.basis.slopes(np.zeros(1))[0], curve.basis.columns(np.array([phi]))[0]])
    k0, torque = rows @ curve.coefficients
    k2 = (torque / (k0 * phi) - 1.0) / phi**2
    # Jacobian of (k0, k2) by (k0, torque), for first-order propagation of the covariance.
    jacobian = np.array([[1.0, 0.0], [-torque / (k0**2 * phi**3), 1.0 / (k0 * phi**3)]])
    covariance = jacobian @ rows @ curve.covariance @ rows.T @ jacobian.T
    k0_std, k2_std = np.sqrt(np.diag(covariance))
    return LawValues(
        float(k0),
        float(k0_std),
        float(k2),
        float(k2_std),
        float(covariance[0, 1] / (k0_std * k2_std)),
        curve.reach,
    )
