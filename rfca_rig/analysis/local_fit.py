"""Local quadratic least squares over a window in time: value, slope and curvature of a noisy trace."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

# Three samples determine the parabola; two more begin to average noise.
MIN_SAMPLES = 5


@dataclass(frozen=True)
class LocalFit:
    """Parabolas fitted around each of `t_s` (m,): value, slope per second, curvature per second squared; NaN with too few samples.

    `mean` of the same samples is less sharp. Beside a jump it stays within the range of the samples, which a parabola does not.
    """

    t_s: Floats
    mean: Floats
    value: Floats
    slope: Floats
    curvature: Floats


def local_quadratic(t_s: Floats, values: Floats, at_s: Floats, width_s: float) -> LocalFit:
    """Fit a parabola to the samples in a window around each of `at_s`.

    Parameters
    ----------
    t_s, values : (n,) samples, `t_s` ascending, in s, evenly spaced or not
    at_s : (m,) centres of the windows, in s
    width_s : whole width of a window, in s

    Returns
    -------
    LocalFit : arrays (m,), NaN where fewer than MIN_SAMPLES lie in the window

    Notes
    -----
    The window is defined in time, so that a trace is smoothed alike at 1 kHz and at 15 kHz.

    References
    ----------
    Savitzky and Golay, Anal. Chem. 36 (1964) 1627, for even spacing.
    """
    first = np.searchsorted(t_s, at_s - 0.5 * width_s, side="left")
    count = np.searchsorted(t_s, at_s + 0.5 * width_s, side="right") - first
    # Windows hold different numbers of samples. They are padded to the longest one, so that all parabolas are solved in one batch.
    row = np.arange(max(int(count.max(initial=0)), 1))
    inside = row < count[:, None]
    pick = np.minimum(first[:, None] + row, len(t_s) - 1)
    # Time in half widths: -1 to 1 within the window; padding counts as zero in all sums.
    x = np.where(inside, (t_s[pick] - at_s[:, None]) / (0.5 * width_s), 0.0)
    y = np.where(inside, values[pick], 0.0)
    c = _parabolas(x, y, inside, count >= MIN_SAMPLES)
    mean = np.where(np.isnan(c[:, 0]), np.nan, y.sum(1) / np.maximum(count, 1))
    return LocalFit(at_s, mean, c[:, 0], c[:, 1] / (0.5 * width_s), 2.0 * c[:, 2] / (0.5 * width_s) ** 2)


def _parabolas(x: Floats, y: Floats, inside: NDArray[np.bool_], enough: NDArray[np.bool_]) -> Floats:
    """Coefficients (m, 3) by the normal equations; x is scaled to -1 .. 1, which keeps them well conditioned."""
    x2 = x * x
    s1, s2, s3, s4 = x.sum(1), x2.sum(1), (x2 * x).sum(1), (x2 * x2).sum(1)
    matrix = np.stack([inside.sum(1), s1, s2, s1, s2, s3, s2, s3, s4], axis=1).reshape(-1, 3, 3)
    right = np.stack([y.sum(1), (x * y).sum(1), (x2 * y).sum(1)], axis=1)
    # Samples at fewer than three distinct times leave the matrix singular, although there are enough of them.
    solvable = enough & (np.linalg.det(matrix) > 1e-6)
    coefficients = np.full((len(x), 3), np.nan)
    coefficients[solvable] = np.linalg.solve(matrix[solvable], right[solvable][..., None])[..., 0]
    return coefficients
