"""How far model and recording may lie apart before something is missing: noise, what differs from stroke to stroke, a model that is a
little wrong everywhere.

    C(s) = D + s^2 K,   D = diag(noise^2) + B B^T

B holds what one standard deviation of each scattering quantity does, drawn anew for every condition. K is the covariance of a smooth
discrepancy in proportion to the signal's size, alike in part between conditions (Kennedy and O'Hagan, J. R. Statist. Soc. B 63 (2001)
425); s is its size, integrated over when hypotheses are compared. One basis makes D the identity and K diagonal, so that all s come at
the price of one.
"""

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cholesky, eigh, solve_triangular

from rfca_rig.diagnosis.rows import Rows

Floats = NDArray[np.float64]

SMOOTH_OVER = 0.06  # of the way from touchdown to valley: some 50 ms
SHARED = 0.5  # correlation of the discrepancy between conditions
FLOOR = 1e-3  # of the discrepancy's variance is not smooth


class Whitening(Protocol):
    """Turns deviations of covariance C into independent ones of variance 1."""

    @property
    def log_det(self) -> float:
        """Log of the determinant of C."""
        ...

    def __call__(self, values: Floats) -> Floats:
        """Of rows (m,) or columns (m, p)."""
        ...


@dataclass(frozen=True)
class Factored:
    """The whitening of a covariance given by its lower Cholesky factor."""

    factor: Floats

    @property
    def log_det(self) -> float:
        return 2.0 * float(np.log(np.diag(self.factor)).sum())

    def __call__(self, values: Floats) -> Floats:
        return np.asarray(solve_triangular(self.factor, values, lower=True, check_finite=False))


def factored(covariance: Floats) -> Factored:
    """The whitening of this covariance (m, m)."""
    return Factored(cholesky(covariance, lower=True, check_finite=False))


@dataclass(frozen=True)
class Basis:
    """`turn` (m, m) with turn D turn^T = 1 and turn K turn^T = diag(`strength`); `back` is its inverse; log of the determinant of D."""

    turn: Floats
    back: Floats
    strength: Floats
    log_det: float


@dataclass(frozen=True)
class AtError:
    """The whitening of C(s)."""

    basis: Basis
    s: float

    @property
    def log_det(self) -> float:
        return self.basis.log_det + float(np.log1p(self.s**2 * self.basis.strength).sum())

    def __call__(self, values: Floats) -> Floats:
        return self.scaled(self.basis.turn @ values)

    def scaled(self, turned: Floats) -> Floats:
        """The same of values that were turned into the basis already."""
        scale = 1.0 / np.sqrt(1.0 + self.s**2 * self.basis.strength)
        return turned * (scale if turned.ndim == 1 else scale[:, None])

    def covariance(self) -> Floats:
        """C(s), (m, m)."""
        return (self.basis.back * (1.0 + self.s**2 * self.basis.strength)) @ self.basis.back.T

    def variance(self) -> Floats:
        """The diagonal of C(s), (m,)."""
        return np.asarray(self.basis.back**2 @ (1.0 + self.s**2 * self.basis.strength))


def discrepancy(rows: Rows) -> Floats:
    """K (m, m): the covariance of a discrepancy of relative size 1."""
    same_signal = (rows.signal[:, None] == rows.signal) & (rows.experiment[:, None] == rows.experiment)
    same_way = (rows.phase[:, None] == rows.phase) | (rows.experiment == "dynamic")[:, None]
    together = np.where(rows.condition[:, None] == rows.condition, 1.0, SHARED)
    length = np.where(rows.experiment == "dynamic", SMOOTH_OVER, 1.0)
    apart = (rows.progress[:, None] - rows.progress) / np.maximum(length[:, None], length)
    smooth = np.exp(-0.5 * apart**2) * together * (same_signal & same_way)
    return np.asarray(rows.scale[:, None] * smooth * rows.scale + np.diag(FLOOR * rows.scale**2 + rows.jolt**2))


def basis_of(rows: Rows, scatter: Floats) -> Basis:
    """The basis of these rows; `scatter` (m, k) is B."""
    root = cholesky(scatter @ scatter.T + np.diag(rows.noise**2), lower=True, check_finite=False)
    half = solve_triangular(root, discrepancy(rows), lower=True, check_finite=False)
    inside = solve_triangular(root, half.T, lower=True, check_finite=False)
    strength, vectors = eigh(0.5 * (inside + inside.T), check_finite=False, driver="evd")
    turn = solve_triangular(root, vectors, lower=True, trans="T", check_finite=False).T
    return Basis(np.ascontiguousarray(turn), root @ vectors, np.maximum(strength, 0.0), 2.0 * float(np.log(np.diag(root)).sum()))
