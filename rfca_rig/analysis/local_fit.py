"""Local quadratic least squares over a window in time: value, slope and curvature of a noisy trace."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

FEWEST_SAMPLES = 5  # three are the parabola itself; two more begin to average noise


@dataclass(frozen=True)
class LocalFit:
    """The parabola fitted around each of `t_s` (m,): value, slope per second, curvature per second squared; NaN where samples lack.

    `mean` of the same samples is blunter, but unlike a parabola beside a jump it never goes beyond them.
    """

    t_s: Floats
    mean: Floats
    value: Floats
    slope: Floats
    curvature: Floats


def local_quadratic(t_s: Floats, values: Floats, at_s: Floats, width_s: float) -> LocalFit:
    """Fits a parabola to the samples within `width_s` (whole width) around each of `at_s` (m,).

    `t_s`, `values` (n,) with `t_s` ascending, at any and at uneven spacing: the window is one of time, so that a trace smooths alike
    at 1 kHz and at 15 kHz. Savitzky and Golay, Anal. Chem. 36 (1964) 1627, is the case of even spacing.
    """
    first = np.searchsorted(t_s, at_s - 0.5 * width_s, side="left")
    count = np.searchsorted(t_s, at_s + 0.5 * width_s, side="right") - first
    row = np.arange(max(int(count.max(initial=0)), 1))
    inside = row < count[:, None]
    pick = np.minimum(first[:, None] + row, len(t_s) - 1)
    x = np.where(inside, (t_s[pick] - at_s[:, None]) / (0.5 * width_s), 0.0)
    y = np.where(inside, values[pick], 0.0)
    c = _parabolas(x, y, inside, count >= FEWEST_SAMPLES)
    mean = np.where(np.isnan(c[:, 0]), np.nan, y.sum(1) / np.maximum(count, 1))
    return LocalFit(at_s, mean, c[:, 0], c[:, 1] / (0.5 * width_s), 2.0 * c[:, 2] / (0.5 * width_s) ** 2)


def _parabolas(x: Floats, y: Floats, inside: NDArray[np.bool_], enough: NDArray[np.bool_]) -> Floats:
    """Coefficients (m, 3) by the normal equations; x is scaled to -1 .. 1, which keeps them well conditioned."""
    x2 = x * x
    s1, s2, s3, s4 = x.sum(1), x2.sum(1), (x2 * x).sum(1), (x2 * x2).sum(1)
    matrix = np.stack([inside.sum(1), s1, s2, s1, s2, s3, s2, s3, s4], axis=1).reshape(-1, 3, 3)
    right = np.stack([y.sum(1), (x * y).sum(1), (x2 * y).sum(1)], axis=1)
    solvable = enough & (np.linalg.det(matrix) > 1e-6)
    coefficients = np.full((len(x), 3), np.nan)
    coefficients[solvable] = np.linalg.solve(matrix[solvable], right[solvable][..., None])[..., 0]
    return coefficients
