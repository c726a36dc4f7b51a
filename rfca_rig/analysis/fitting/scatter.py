"""What differs from stroke to stroke, so that it is not taken for what all strokes share.

The rack stands a tenth of a millimetre elsewhere each time, the floor grips a little more, the encoder reads a little less: each moves all
values of a stroke together, by more than the noise. They are taken as drawn anew for each stroke, with a standard deviation that is found
from the strokes themselves where there are enough (expectation maximisation: Laird and Ware, Biometrics 38 (1982) 963), and residuals
are freed of them before they are squared and summed.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

USUAL: Mapping[str, float] = {"height": 0.15, "friction": 0.008, "start_angle": 0.1}  # mm, 1, deg
ENOUGH_STROKES = 6
ROUNDS = 30


@dataclass(frozen=True)
class StrokeWhitening:
    """Turns residuals whose strokes have something in common into independent ones of variance 1.

    `parts` holds for each stroke its rows, the directions U (m_s, k) in which its values move together, and how much to shrink them (k,).
    """

    parts: tuple[tuple[slice, Floats, Floats], ...] = ()

    def __call__(self, values: Floats) -> Floats:
        """Of residuals (m,) or of a Jacobian (m, p): C^(-1/2) of each stroke with C = 1 + B B^T."""
        white = values.copy()
        for rows, directions, shrink in self.parts:
            white[rows] -= directions @ (shrink * (directions.T @ values[rows]).T).T
        return white


def whitening_of(effect: Floats, stroke_of_row: NDArray[np.intp]) -> StrokeWhitening:
    """From what one standard deviation of each scattering quantity does, `effect` (m, k); rows of a stroke are adjacent."""
    return StrokeWhitening(tuple(_part(rows, effect[rows]) for rows in _slices(stroke_of_row)))


def found_scatter(std: Floats, effect: Floats, residuals: Floats, stroke_of_row: NDArray[np.intp]) -> Floats:
    """The standard deviations (k,) under which the residuals at the solution are likeliest, from the usual ones `std` on.

    `effect` (m, k) is that of `std`. Deviations count from their mean: what all strokes share is for the fit to find. With fewer than
    six strokes they say too little, and the usual ones stay.
    """
    slices = _slices(stroke_of_row)
    if len(slices) < ENOUGH_STROKES:
        return std
    pairs = [(effect[rows].T @ effect[rows], -effect[rows].T @ residuals[rows]) for rows in slices]
    share = np.ones(len(std))
    for _ in range(ROUNDS):
        means, variances = np.array([_deviation(square, pull, share) for square, pull in pairs]).transpose(1, 0, 2)
        share = np.sqrt(means.var(axis=0, ddof=1) + variances.mean(axis=0))
    return std * np.maximum(share, 1e-3)


def _deviation(square: Floats, pull: Floats, share: Floats) -> tuple[Floats, Floats]:
    """Mean and variance of one stroke's deviations, given its residuals, in units of the usual deviations."""
    covariance = np.linalg.inv(share[:, None] * square * share + np.eye(len(share)))
    return share * (covariance @ (share * pull)), share**2 * np.diag(covariance)


def _part(rows: slice, effect: Floats) -> tuple[slice, Floats, Floats]:
    directions, size, _ = np.linalg.svd(effect, full_matrices=False)
    return rows, directions, 1.0 - 1.0 / np.sqrt(1.0 + size**2)


def _slices(stroke_of_row: NDArray[np.intp]) -> list[slice]:
    borders = np.flatnonzero(np.diff(stroke_of_row, prepend=-1, append=stroke_of_row[-1] + 1))
    return [slice(int(a), int(b)) for a, b in pairwise(borders)]
