"""Scatter between strokes, kept apart from the parameters that all strokes share.

The rack stands a tenth of a millimetre elsewhere each time, friction is a little higher, the
encoder reads a little less. Each of these moves all values of a stroke together, by more than the
noise. They are modelled as random for each stroke. Their standard deviation is estimated from the
strokes where there are enough (expectation maximisation: Laird and Ware, Biometrics 38 (1982) 963).
The residuals are whitened with them before they are squared and summed.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

USUAL_SCATTER: Mapping[str, float] = {
    "height": 0.15,
    "friction": 0.008,
    "start_angle": 0.1,
}  # mm, 1, deg
# Strokes from which on the deviations are estimated, and rounds of expectation maximisation.
ENOUGH_STROKES = 6
ROUNDS = 30


@dataclass(frozen=True)
class StrokeWhitening:
    """Transforms residuals that are correlated within a stroke into independent ones of variance 1.

    `parts` holds for each stroke its rows, the directions U (m_s, k) in which its values move
    together, and their shrinkage (k,).
    """

    parts: tuple[tuple[slice, Floats, Floats], ...] = ()

    def __call__(self, values: Floats) -> Floats:
        """C^(-1/2) of each stroke applied to residuals (m,) or a Jacobian (m, p), with C = 1 + B
        B^T.
        """
        white = values.copy()
        for rows, directions, shrink in self.parts:
            # C^(-1/2) differs from 1 only along the directions of B, so no (m, m) matrix is needed.
            white[rows] -= directions @ (shrink * (directions.T @ values[rows]).T).T
        return white


def make_whitening(effect: Floats, stroke_of_row: NDArray[np.intp]) -> StrokeWhitening:
    """Whitening for `effect` (m, k), the change per standard deviation of each scattering
    quantity; rows of a stroke are adjacent.
    """
    return StrokeWhitening(tuple(_part(rows, effect[rows]) for rows in _slices(stroke_of_row)))


def estimate_scatter_std(
    std: Floats, effect: Floats, residuals: Floats, stroke_of_row: NDArray[np.intp]
) -> Floats:
    """Most likely standard deviations (k,) of the scatter, given the residuals at the solution,
    starting from the usual ones `std`.

    Parameters
    ----------
    std : (k,) usual standard deviations
    effect : (m, k) effect of `std` on the residuals
    residuals : (m,) at the solution
    stroke_of_row : (m,) index of the stroke of each row

    Notes
    -----
    Deviations count from their mean, because what all strokes share is left to the fit. With fewer
    than six strokes the usual values are returned.

    References
    ----------
    Laird and Ware, Biometrics 38 (1982) 963.
    """
    slices = _slices(stroke_of_row)
    if len(slices) < ENOUGH_STROKES:
        return std
    pairs = [(effect[rows].T @ effect[rows], -effect[rows].T @ residuals[rows]) for rows in slices]
    share = np.ones(len(std))
    for _ in range(ROUNDS):
        means, variances = np.array(
            [_deviation(square, pull, share) for square, pull in pairs]
        ).transpose(1, 0, 2)
        # M step: variance between the strokes' estimates plus the mean uncertainty of one estimate.
        share = np.sqrt(means.var(axis=0, ddof=1) + variances.mean(axis=0))
    return std * np.maximum(share, 1e-3)


def _deviation(square: Floats, pull: Floats, share: Floats) -> tuple[Floats, Floats]:
    """Mean and variance of one stroke's deviations given its residuals (E step), in units of the
    usual deviations.
    """
    covariance = np.linalg.inv(share[:, None] * square * share + np.eye(len(share)))
    return share * (covariance @ (share * pull)), share**2 * np.diag(covariance)


def _part(rows: slice, effect: Floats) -> tuple[slice, Floats, Floats]:
    # With B = U S V^T, the eigenvalues of C are 1 + s^2; shrinking by 1 - 1 / sqrt(1 + s^2) applies
    # C^(-1/2).
    directions, size, _ = np.linalg.svd(effect, full_matrices=False)
    return rows, directions, 1.0 - 1.0 / np.sqrt(1.0 + size**2)


def _slices(stroke_of_row: NDArray[np.intp]) -> list[slice]:
    borders = np.flatnonzero(np.diff(stroke_of_row, prepend=-1, append=stroke_of_row[-1] + 1))
    return [slice(int(a), int(b)) for a, b in pairwise(borders)]
