"""Covariance of the observations: sensor noise, scatter from repeat to repeat, and model
discrepancy.

    C(s) = D + s^2 K + B B^T,   D = diag(noise^2)

B holds the effect of one standard deviation of each scattering quantity. Each condition has columns
of its own, since scatter is independent between conditions. K is the covariance of a smooth
discrepancy that is proportional to the signal and partly shared between conditions (Kennedy and
O'Hagan, J. R. Statist. Soc. B 63 (2001) 425). Its scale s is integrated out when hypotheses are
compared.

K couples only rows of one signal. So each block of rows has a basis in which D is the identity and
K is diagonal, and all s cost as much as one. B has low rank, a few columns per condition, and is
added by Woodbury's identity.

B is estimated from the repeats. The rack stands a tenth of a millimetre elsewhere in each repeat,
and the friction is a little higher. In the mean of the repeats this scatter remains, divided by the
root of their number, in directions that the model predicts.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cholesky, eigh, solve_triangular

from rfca_rig.analysis.fitting.scatter import estimate_scatter_std
from rfca_rig.diagnosis.config import CONDITION_CORRELATION, ROUGH_VARIANCE_SHARE
from rfca_rig.diagnosis.data import Observations
from rfca_rig.diagnosis.simulator import Dataset, ScatterDirection

Floats = NDArray[np.float64]
Integers = NDArray[np.intp]


class Whitening(Protocol):
    """Maps deviations of covariance C to independent ones of variance 1: values (m,) or columns
    (m, p).
    """

    @property
    def log_det(self) -> float:
        """Log of the determinant of C."""
        ...

    def __call__(self, values: Floats) -> Floats:
        """Whiten rows (m,) or columns (m, p); the result has the same shape."""
        ...


@dataclass(frozen=True)
class CholeskyWhitening:
    """Whitening of a covariance, given by its lower Cholesky factor (m, m)."""

    factor: Floats

    @property
    def log_det(self) -> float:
        return 2.0 * float(np.log(np.diag(self.factor)).sum())

    def __call__(self, values: Floats) -> Floats:
        return np.asarray(solve_triangular(self.factor, values, lower=True, check_finite=False))


def make_whitening(covariance: Floats) -> CholeskyWhitening:
    """Whitening of a covariance (m, m), which must be positive definite."""
    return CholeskyWhitening(cholesky(covariance, lower=True, check_finite=False))


@dataclass(frozen=True)
class SignalBlock:
    """Rows of one signal that are correlated under K, with the basis that diagonalises D and K.

    Parameters
    ----------
    of
        (b,) numbers of the rows.
    turn, back
        (b, b) the matrix T with T D T^T = 1 and T K T^T = diag(`strength`), and its inverse.
    strength
        (b,) eigenvalues of K relative to D.
    """

    of: Integers
    turn: Floats
    back: Floats
    strength: Floats


@dataclass(frozen=True)
class DiscrepancyBasis:
    """The blocks of all rows, which stand below each other in this basis.

    Parameters
    ----------
    blocks
        One per signal, see `SignalBlock`.
    scatter
        (m, k) the matrix B.
    log_det
        Log of the determinant of D.
    """

    blocks: tuple[SignalBlock, ...]
    scatter: Floats
    log_det: float

    def turned(self, values: Floats) -> Floats:
        """Map rows (m,) or columns (m, p) to this basis."""
        return np.concatenate([block.turn @ values[block.of] for block in self.blocks])

    def apply_transpose(self, turned: Floats) -> Floats:
        """Apply the transpose of `turned` to columns (m, p): back to the order of the rows."""
        columns = np.empty_like(turned)
        for block, part in zip(self.blocks, self.parts(turned), strict=True):
            columns[block.of] = block.turn.T @ part
        return columns

    def parts(self, turned: Floats) -> list[Floats]:
        """Split an array (m, ...) of this basis into those of the blocks, (b, ...) each."""
        return np.split(turned, np.cumsum([len(block.of) for block in self.blocks])[:-1])

    @cached_property
    def strength(self) -> Floats:
        """Diagonal of K in this basis, (m,)."""
        return np.concatenate([block.strength for block in self.blocks])

    @cached_property
    def scatter_in_basis(self) -> Floats:
        """B in this basis, (m, k)."""
        return self.turned(self.scatter)


@dataclass(frozen=True)
class _Shrinking:
    """Whitening W of 1 + V V^T, with V = `along` (m, k).

    W = 1 - V G V^T, and its square is the inverse, 1 - V H V^T. With the eigenvalues l of V^T V and
    r = sqrt(1 + l), G has the eigenvalues 1 / (r (r + 1)) and H has 1 / r^2.
    """

    along: Floats
    g: Floats
    h: Floats
    log_det: float

    def __call__(self, values: Floats) -> Floats:
        return np.asarray(values - self.along @ (self.g @ (self.along.T @ values)))


def _shrinking(along: Floats) -> _Shrinking:
    # V^T V is only (k, k), and k is far smaller than m. Rounding may make an eigenvalue slightly
    # negative, hence the maximum.
    values, vectors = np.linalg.eigh(along.T @ along)
    r = np.sqrt(1.0 + np.maximum(values, 0.0))
    return _Shrinking(
        along,
        (vectors / (r * (r + 1.0))) @ vectors.T,
        (vectors / r**2) @ vectors.T,
        2.0 * float(np.log(r).sum()),
    )


@dataclass(frozen=True)
class DiscrepancyWhitening:
    """Whitening of C(s) at one discrepancy scale.

    Parameters
    ----------
    basis
        The basis of D and K, with B (m, k).
    s
        The discrepancy scale, as a share of the signal: 0.01 is the usual 1 %.
    """

    basis: DiscrepancyBasis
    s: float

    @property
    def log_det(self) -> float:
        # |C| = |D| |1 + s^2 K| |1 + V V^T|, each factor in the basis; `_scale` is the inverse root
        # of the middle one.
        return self.basis.log_det - 2.0 * float(np.log(self._scale).sum()) + self._shrinking.log_det

    @cached_property
    def _scale(self) -> Floats:
        return np.asarray(1.0 / np.sqrt(1.0 + self.s**2 * self.basis.strength))

    @cached_property
    def _shrinking(self) -> _Shrinking:
        return _shrinking(self._scale[:, None] * self.basis.scatter_in_basis)

    def __call__(self, values: Floats) -> Floats:
        return self.scaled(self.basis.turned(values))

    def scaled(self, turned: Floats) -> Floats:
        """Whiten rows (m,) or columns (m, p) that are in the basis already."""
        return self._shrinking(turned * (self._scale if turned.ndim == 1 else self._scale[:, None]))

    def apply_precision(self, values: Floats) -> Floats:
        """C(s)^-1 times columns (m, p)."""
        return self.basis.apply_transpose(self._scale[:, None] * self._shrinking(self(values)))

    def precision(self, rows: NDArray[np.bool_]) -> Floats:
        """The block (k, k) of C(s)^-1 that belongs to k of the rows; `rows` is a mask (m,)."""
        # C^-1 = T^T S (1 - V H V^T) S T, with S = diag(`_scale`). Only the columns of S T that
        # belong to these rows are formed. So the full inverse (m, m) is never needed.
        index = np.cumsum(rows) - 1
        precision = np.zeros((int(rows.sum()),) * 2)
        along = np.empty((int(rows.sum()), self.basis.scatter.shape[1]))
        parts = zip(
            self.basis.blocks,
            self.basis.parts(self._scale),
            self.basis.parts(self._shrinking.along),
            strict=True,
        )
        for block, scale, scatter in parts:
            kept = rows[block.of]
            columns = scale[:, None] * block.turn[:, kept]
            at = index[block.of[kept]]
            precision[np.ix_(at, at)] = columns.T @ columns
            along[at] = columns.T @ scatter
        return np.asarray(precision - along @ self._shrinking.h @ along.T)

    def covariance(self) -> Floats:
        """C(s), (m, m)."""
        covariance = self.basis.scatter @ self.basis.scatter.T
        for block in self.basis.blocks:
            # T^-1 (1 + s^2 diag(strength)) T^-T is the block of D + s^2 K.
            covariance[np.ix_(block.of, block.of)] += (
                block.back * (1.0 + self.s**2 * block.strength)
            ) @ block.back.T
        return np.asarray(covariance)

    def draw(self, draws: int, random: np.random.Generator) -> Floats:
        """Deviations (draws, m) of covariance C(s)."""
        deviations = random.normal(size=(draws, self.basis.scatter.shape[1])) @ self.basis.scatter.T
        for block in self.basis.blocks:
            independent = random.normal(size=(draws, len(block.of)))
            sizes = np.sqrt(1.0 + self.s**2 * block.strength)
            deviations[:, block.of] += (independent * sizes) @ block.back.T
        return np.asarray(deviations)

    def variance(self) -> Floats:
        """The diagonal of C(s), (m,)."""
        variance = (self.basis.scatter**2).sum(axis=1)
        for block in self.basis.blocks:
            variance[block.of] += block.back**2 @ (1.0 + self.s**2 * block.strength)
        return np.asarray(variance)


def discrepancy_covariance(rows: Observations) -> Floats:
    """K (m, m): the covariance of a discrepancy of relative size 1, in the units of the rows."""
    covariance = np.zeros((len(rows.measured),) * 2)
    for of in _alike(rows):
        covariance[np.ix_(of, of)] = _discrepancy_within(rows, of)
    return covariance


def _alike(rows: Observations) -> list[Integers]:
    """Row numbers of each block: the rows of one signal that are correlated, one phase at a time
    where the label says so.
    """
    way = np.where(
        np.array([label.errs_by_phase for label in rows.labels])[rows.label], rows.phase, ""
    )
    keys = np.stack(
        [np.unique(key, return_inverse=True)[1] for key in (rows.signal, rows.experiment, way)]
    )
    group = np.unique(keys, axis=1, return_inverse=True)[1].ravel()
    return [np.flatnonzero(group == number) for number in range(int(group.max()) + 1)]


def _discrepancy_within(rows: Observations, of: Integers) -> Floats:
    """K (b, b) of the rows of one block: equation for K_ij in section 3 of docs/method.md."""
    scale = rows.scale[of]
    # The diagonal holds what is independent between rows: a small share of the variance, and
    # `transient_scale`.
    rough = np.diag(ROUGH_VARIANCE_SHARE * scale**2 + rows.transient_scale[of] ** 2)
    return np.asarray(scale[:, None] * _correlation_within(rows, of) * scale + rough)


def _correlation_within(rows: Observations, of: Integers) -> Floats:
    """Correlation (b, b) of a smooth error of the rows of one block."""
    condition = rows.condition[of]
    together = np.where(condition[:, None] == condition, 1.0, CONDITION_CORRELATION)
    # All labels of one signal of one experiment have the same correlation length, so the first is
    # enough.
    apart = (rows.progress[of][:, None] - rows.progress[of]) / rows.labels[
        rows.label[of[0]]
    ].correlation_length
    return np.asarray(np.exp(-0.5 * apart**2) * together)


def propagate_smooth_error(rows: Observations, sizes: Sequence[Floats], gain: Floats) -> Floats:
    """Variances (p,) of `gain` (p, m) times independent errors, as smooth as the discrepancy,
    with deviations `sizes` (m,) each.
    """
    variance = np.zeros(len(gain))
    for of in _alike(rows):
        correlation = _correlation_within(rows, of)
        for size in sizes:
            scaled = gain[:, of] * size[of]
            variance += np.einsum("ij,ij->i", scaled @ correlation, scaled)
    return variance


def make_basis(rows: Observations, scatter: Floats) -> DiscrepancyBasis:
    """The basis in which D and K of these rows are diagonal; `scatter` (m, k) is B."""
    return DiscrepancyBasis(
        tuple(_block(rows, of) for of in _alike(rows)),
        scatter,
        2.0 * float(np.log(rows.noise).sum()),
    )


def _block(rows: Observations, of: Integers) -> SignalBlock:
    noise = rows.noise[of]
    # The eigenvectors of D^-1/2 K D^-1/2 diagonalise K and keep D the identity. K has no negative
    # eigenvalue except by rounding.
    strength, vectors = eigh(
        _discrepancy_within(rows, of) / np.outer(noise, noise), check_finite=False, driver="evd"
    )
    return SignalBlock(
        of,
        np.ascontiguousarray(vectors.T / noise),
        noise[:, None] * vectors,
        np.maximum(strength, 0.0),
    )


@dataclass(frozen=True)
class RepeatScatter:
    """Standard deviations `std` by parameter, and `columns` (m, k): the effect of one of them on
    the rows of one condition's mean.
    """

    std: dict[str, float]
    columns: Floats


def estimate_scatter(dataset: Dataset, at: Any) -> RepeatScatter:
    """The scatter around this input of the simulator; usual deviations where there are too few
    repeats to estimate it.
    """
    directions = dataset.simulator.scatter(at, dataset.parts)
    effect = _effects(dataset, directions)
    usual = np.array([direction.std for direction in directions])
    std = _estimate_std(dataset, effect, usual)
    scatter = effect * (std / usual)
    # A quantity that is simulated from its recorded value leaves no scatter in the mean.
    scatter[:, [direction.is_corrected for direction in directions]] = 0.0
    return RepeatScatter(
        {direction.name: float(s) for direction, s in zip(directions, std, strict=True)},
        np.column_stack(
            [_per_condition(dataset, scatter), dataset.simulator.known_scatter(dataset.parts)]
        ),
    )


def _effects(dataset: Dataset, directions: Sequence[ScatterDirection]) -> Floats:
    """Effect of one usual deviation of each quantity on the rows, (m, k), by central
    differences; 0 where the model has no answer.
    """
    predictions = dataset.predict_all(
        [
            *(direction.above for direction in directions),
            *(direction.below for direction in directions),
        ]
    )
    columns = np.zeros((len(dataset.rows.measured), len(directions)))
    for k, (above, below) in enumerate(
        zip(predictions[: len(directions)], predictions[len(directions) :], strict=True)
    ):
        if above is not None and below is not None:
            columns[:, k] = 0.5 * (above - below)
    return columns


def _estimate_std(dataset: Dataset, effect: Floats, usual: Floats) -> Floats:
    """Standard deviations (k,) from the deviations of the repeats from their mean, by
    expectation maximisation.
    """
    rows = dataset.rows
    residuals: list[Floats] = []
    effects: list[Floats] = []
    repeat: list[NDArray[np.intp]] = []
    for number, repeats in enumerate(part.repeats for part in dataset.parts):
        mask = rows.condition == number
        count = len(repeats)
        if count < 2:
            continue
        # The noise of the rows is that of the mean over the repeats; a single repeat has
        # sqrt(count) times as much.
        noise = np.sqrt(count) * rows.noise[mask]
        # The mean uses one degree of freedom; the factor restores the variance of a single repeat.
        for deviation in (repeats - repeats.mean(axis=0)) * np.sqrt(count / (count - 1.0)):
            repeat.append(np.full(len(noise), len(repeat)))
            residuals.append(-deviation / noise)
            effects.append(effect[mask] / noise[:, None])
    if not residuals or not len(usual):
        return usual
    return estimate_scatter_std(
        usual, np.concatenate(effects), np.concatenate(residuals), np.concatenate(repeat)
    )


def _per_condition(dataset: Dataset, effect: Floats) -> Floats:
    """B (m, k): one column per condition and quantity. Conditions scatter independently, and
    less the more repeats are averaged.
    """
    condition = dataset.rows.condition
    columns = []
    for number, part in enumerate(dataset.parts):
        for k in range(effect.shape[1]):
            column = np.where(condition == number, effect[:, k], 0.0)
            if np.any(column):
                columns.append(column / np.sqrt(len(part.repeats)))
    if columns:
        return np.column_stack(columns)
    return np.empty((len(condition), 0))
