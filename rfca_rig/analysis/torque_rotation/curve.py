"""A torque-rotation curve with its uncertainty."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.stats import t as student

from rfca_rig.analysis.torque_rotation.bases import Basis

Floats = NDArray[np.float64]

CONFIDENCE = 0.95


@dataclass(frozen=True)
class TorqueCurve:
    """Torque of a hinge over its angle: coefficients (size,) of a basis with covariance (size, size), valid over `range_rad`.

    `freedom` is the number of degrees of freedom. `bends` is the sign of most angles; multiplied by it, the curve has bending positive.
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
        """Equivalent stiffness (m,), the derivative of the torque, and its standard deviation (m,), at angles (m,)."""
        return self._of(self.basis.slopes(phi_rad))

    def grid_rad(self, count: int = 101) -> Floats:
        """Angles (count,) over the range, from the least bent on."""
        low, high = self.range_rad
        return np.linspace(low, high, count) if self.bends > 0 else np.linspace(high, low, count)

    def _of(self, columns: Floats) -> tuple[Floats, Floats]:
        variance = np.einsum("mi,ij,mj->m", columns, self.covariance, columns)
        return columns @ self.coefficients, np.sqrt(np.maximum(variance, 0.0))


@dataclass(frozen=True)
class LawValues:
    """k0 and k2 of the law k0 (phi + k2 phi^3), one standard deviation each, their correlation, and the half width of 95 % in
    deviations.
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
        return {"k0_relative": self.k0_std / self.k0_Nm_per_rad, "k2_relative": self.k2_std / abs(self.k2_per_rad2)}


def law_values(curve: TorqueCurve) -> LawValues:
    """k0 and k2 of a curve on the law's own basis."""
    a, b = curve.coefficients
    # Jacobian of (a, b / a) by (a, b), for first-order propagation of the covariance.
    jacobian = np.array([[1.0, 0.0], [-b / a**2, 1.0 / a]])
    covariance = jacobian @ curve.covariance @ jacobian.T
    k0_std, k2_std = np.sqrt(np.diag(covariance))
    return LawValues(float(a), float(k0_std), float(b / a), float(k2_std), float(covariance[0, 1] / (k0_std * k2_std)), curve.reach)
