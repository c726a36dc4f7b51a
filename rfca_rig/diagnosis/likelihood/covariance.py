"""How far model and recording may lie apart before something is missing: noise, what differs from repeat to repeat, a model that is a
little wrong everywhere.

    C(s) = D + s^2 K + B B^T,   D = diag(noise^2)

B holds what one standard deviation of each scattering quantity does, drawn anew for every condition. K is the covariance of a smooth
discrepancy in proportion to the signal's size, alike in part between conditions (Kennedy and O'Hagan, J. R. Statist. Soc. B 63 (2001)
425); s is its size, integrated over when hypotheses are compared. K ties only rows of one signal to each other: block by block one
basis makes D the identity and K diagonal, so that all s come at the price of one. B is low, some columns a condition, and is added
by Woodbury's identity.
"""

from dataclasses import dataclass
from functools import cached_property
from typing import Protocol

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cholesky, eigh, solve_triangular

from rfca_rig.diagnosis.config import FLOOR, SHARED
from rfca_rig.diagnosis.data.observations import Observations

Floats = NDArray[np.float64]
Integers = NDArray[np.intp]


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
class SignalBlock:
    """The rows `of` one signal (b,), with `turn` D turn^T = 1 and `turn` K turn^T = diag(`strength`); `back` is the inverse of `turn`."""

    of: Integers
    turn: Floats
    back: Floats
    strength: Floats


@dataclass(frozen=True)
class DiscrepancyBasis:
    """The blocks, whose rows are below each other in it; `scatter` (m, k) is B; log of the determinant of D."""

    blocks: tuple[SignalBlock, ...]
    scatter: Floats
    log_det: float

    def turned(self, values: Floats) -> Floats:
        """Rows (m,) or columns (m, p) in this basis."""
        return np.concatenate([block.turn @ values[block.of] for block in self.blocks])

    def turned_again(self, turned: Floats) -> Floats:
        """The transpose of that, back in the rows' order."""
        found = np.empty_like(turned)
        for block, part in zip(self.blocks, self.parts(turned), strict=True):
            found[block.of] = block.turn.T @ part
        return found

    def parts(self, turned: Floats) -> list[Floats]:
        """What is turned, cut into the blocks'."""
        return np.split(turned, np.cumsum([len(block.of) for block in self.blocks])[:-1])

    @cached_property
    def strength(self) -> Floats:
        """K's diagonal, (m,)."""
        return np.concatenate([block.strength for block in self.blocks])

    @cached_property
    def scatter_turned(self) -> Floats:
        """B in this basis."""
        return self.turned(self.scatter)


@dataclass(frozen=True)
class _Shrinking:
    """Whitens for 1 + V V^T: W = 1 - V G V^T with W^2 its inverse, 1 - V H V^T. Of the eigenvalues l of V^T V, r = sqrt(1 + l)
    makes G of 1 / (r (r + 1)) and H of 1 / r^2.
    """

    along: Floats
    g: Floats
    h: Floats
    log_det: float

    def __call__(self, values: Floats) -> Floats:
        return np.asarray(values - self.along @ (self.g @ (self.along.T @ values)))


def _shrinking(along: Floats) -> _Shrinking:
    values, vectors = np.linalg.eigh(along.T @ along)
    r = np.sqrt(1.0 + np.maximum(values, 0.0))
    return _Shrinking(along, (vectors / (r * (r + 1.0))) @ vectors.T, (vectors / r**2) @ vectors.T, 2.0 * float(np.log(r).sum()))


@dataclass(frozen=True)
class AtError:
    """The whitening of C(s)."""

    basis: DiscrepancyBasis
    s: float

    @property
    def log_det(self) -> float:
        return self.basis.log_det - 2.0 * float(np.log(self._scale).sum()) + self._shrinking.log_det

    @cached_property
    def _scale(self) -> Floats:
        return np.asarray(1.0 / np.sqrt(1.0 + self.s**2 * self.basis.strength))

    @cached_property
    def _shrinking(self) -> _Shrinking:
        return _shrinking(self._scale[:, None] * self.basis.scatter_turned)

    def __call__(self, values: Floats) -> Floats:
        return self.scaled(self.basis.turned(values))

    def scaled(self, turned: Floats) -> Floats:
        """The same of values that were turned into the basis already."""
        return self._shrinking(turned * (self._scale if turned.ndim == 1 else self._scale[:, None]))

    def weighted(self, values: Floats) -> Floats:
        """C(s)^-1 times columns (m, p)."""
        return self.basis.turned_again(self._scale[:, None] * self._shrinking(self(values)))

    def precision(self, rows: NDArray[np.bool_]) -> Floats:
        """Of C(s)^-1 what ties these rows to each other, (k, k)."""
        place = np.cumsum(rows) - 1
        found, along = np.zeros((int(rows.sum()),) * 2), np.empty((int(rows.sum()), self.basis.scatter.shape[1]))
        parts = zip(self.basis.blocks, self.basis.parts(self._scale), self.basis.parts(self._shrinking.along), strict=True)
        for block, scale, scatter in parts:
            kept = rows[block.of]
            own, at = scale[:, None] * block.turn[:, kept], place[block.of[kept]]
            found[np.ix_(at, at)], along[at] = own.T @ own, own.T @ scatter
        return np.asarray(found - along @ self._shrinking.h @ along.T)

    def covariance(self) -> Floats:
        """C(s), (m, m)."""
        found = self.basis.scatter @ self.basis.scatter.T
        for block in self.basis.blocks:
            found[np.ix_(block.of, block.of)] += (block.back * (1.0 + self.s**2 * block.strength)) @ block.back.T
        return np.asarray(found)

    def variance(self) -> Floats:
        """The diagonal of C(s), (m,)."""
        found = (self.basis.scatter**2).sum(axis=1)
        for block in self.basis.blocks:
            found[block.of] += block.back**2 @ (1.0 + self.s**2 * block.strength)
        return np.asarray(found)


def discrepancy(rows: Observations) -> Floats:
    """K (m, m): the covariance of a discrepancy of relative size 1."""
    found = np.zeros((len(rows.measured),) * 2)
    for of in _alike(rows):
        found[np.ix_(of, of)] = _discrepancy_within(rows, of)
    return found


def _alike(rows: Observations) -> list[Integers]:
    """The rows of each signal that err together, one phase at a time where its label says so."""
    way = np.where(np.array([label.errs_by_phase for label in rows.labels])[rows.label], rows.phase, "")
    keys = np.stack([np.unique(key, return_inverse=True)[1] for key in (rows.signal, rows.experiment, way)])
    group = np.unique(keys, axis=1, return_inverse=True)[1].ravel()
    return [np.flatnonzero(group == number) for number in range(int(group.max()) + 1)]


def _discrepancy_within(rows: Observations, of: Integers) -> Floats:
    """K of rows that err together."""
    condition, scale = rows.condition[of], rows.scale[of]
    together = np.where(condition[:, None] == condition, 1.0, SHARED)
    apart = (rows.progress[of][:, None] - rows.progress[of]) / rows.labels[rows.label[of[0]]].correlation_length
    smooth = np.exp(-0.5 * apart**2) * together
    return np.asarray(scale[:, None] * smooth * scale + np.diag(FLOOR * scale**2 + rows.jolt[of] ** 2))


def basis_of(rows: Observations, scatter: Floats) -> DiscrepancyBasis:
    """The basis of these rows; `scatter` (m, k) is B."""
    return DiscrepancyBasis(tuple(_block(rows, of) for of in _alike(rows)), scatter, 2.0 * float(np.log(rows.noise).sum()))


def _block(rows: Observations, of: Integers) -> SignalBlock:
    noise = rows.noise[of]
    strength, vectors = eigh(_discrepancy_within(rows, of) / np.outer(noise, noise), check_finite=False, driver="evd")
    return SignalBlock(of, np.ascontiguousarray(vectors.T / noise), noise[:, None] * vectors, np.maximum(strength, 0.0))
