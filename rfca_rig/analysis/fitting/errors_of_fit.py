"""Standard errors of a fit whose residuals are not independent.

What differs from stroke to stroke (friction, height, how the leg swings at the start) moves all residuals of a stroke together, and the
textbook covariance, which counts every value as a witness of its own, comes out several times too small. With enough strokes their own
scatter tells (White, Econometrica 48 (1980) 817, summed over clusters as Liang and Zeger, Biometrika 73 (1986) 13); with few, the
textbook's is widened by one factor.
"""

import numpy as np
from numpy.typing import NDArray

from rfca_rig.analysis.fitting.space import FARTHEST

Floats = NDArray[np.float64]

ENOUGH_STROKES = 10


def covariance_of(residuals: Floats, jacobian: Floats, has_prior: NDArray[np.bool_], stroke_of_row: NDArray[np.intp]) -> tuple[Floats, str]:
    """Covariance (p, p) of the fitted coordinates, and in words where it comes from.

    `residuals` (m,) and `jacobian` (m, p) are the data's at the solution, in units of noise; the prior is 1 per coordinate that has one.
    A coordinate without is known to lie within its bounds at least, or what nothing determines would have no error at all.
    """
    prior = np.diag(np.where(has_prior, 1.0, FARTHEST**-2))
    information = jacobian.T @ jacobian
    inverse = np.linalg.inv(information + prior)
    scatter, strokes = _scatter(residuals, jacobian, stroke_of_row)
    if strokes >= max(ENOUGH_STROKES, 2 * jacobian.shape[1]):
        return inverse @ (scatter + prior) @ inverse, f"errors from the scatter between {strokes} strokes"
    free = max(len(residuals) - jacobian.shape[1], 1)
    factor = max(1.0, float(residuals @ residuals) / free, float(np.trace(inverse @ scatter) / np.trace(inverse @ information)))
    return inverse @ (factor * information + prior) @ inverse, f"errors from the noise, widened {np.sqrt(factor):.1f} times"


def _scatter(residuals: Floats, jacobian: Floats, stroke_of_row: NDArray[np.intp]) -> tuple[Floats, int]:
    """Sum over strokes of the outer product of each one's pull on the parameters."""
    strokes = int(stroke_of_row.max()) + 1
    pulls = np.array([jacobian[stroke_of_row == s].T @ residuals[stroke_of_row == s] for s in range(strokes)])
    return pulls.T @ pulls * strokes / max(strokes - 1, 1), strokes
