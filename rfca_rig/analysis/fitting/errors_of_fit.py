"""Standard errors of a fit whose residuals are correlated within a stroke.

Quantities that differ from stroke to stroke (friction, height, how the leg swings at the start) move all residuals of a stroke together.
The textbook covariance counts every value as independent and is then several times too small. With enough strokes, their own scatter gives
the errors (White, Econometrica 48 (1980) 817, summed over clusters as Liang and Zeger, Biometrika 73 (1986) 13). With few strokes, the
textbook covariance is widened by one factor.
"""

import numpy as np
from numpy.typing import NDArray

from rfca_rig.analysis.fitting.space import MAX_SHIFT_STD

Floats = NDArray[np.float64]

# Fewer clusters make the sandwich estimate itself too uncertain.
ENOUGH_STROKES = 10


def estimate_covariance(
    residuals: Floats, jacobian: Floats, has_prior: NDArray[np.bool_], stroke_of_row: NDArray[np.intp]
) -> tuple[Floats, str]:
    """Covariance of the fitted coordinates, and a description of its source.

    Parameters
    ----------
    residuals : (m,) of the data at the solution, in units of noise
    jacobian : (m, p) of the same rows
    has_prior : (p,) the prior is 1 per coordinate that has one
    stroke_of_row : (m,) index of the stroke of each row

    Returns
    -------
    covariance : (p, p)
    description : in words

    Notes
    -----
    A coordinate without a prior is taken to lie within its bounds. Otherwise a coordinate that nothing determines would have an infinite
    error.

    References
    ----------
    White (1980); Liang and Zeger (1986).
    """
    prior = np.diag(np.where(has_prior, 1.0, MAX_SHIFT_STD**-2))
    information = jacobian.T @ jacobian
    inverse = np.linalg.inv(information + prior)
    scatter, strokes = _scatter(residuals, jacobian, stroke_of_row)
    if strokes >= max(ENOUGH_STROKES, 2 * jacobian.shape[1]):
        # Sandwich estimator: the information is replaced by the observed scatter of the strokes' gradients.
        return inverse @ (scatter + prior) @ inverse, f"errors from the scatter between {strokes} strokes"
    free = max(len(residuals) - jacobian.shape[1], 1)
    # The larger of the reduced chi2 and the mean ratio of observed to assumed scatter; errors are never made smaller.
    factor = max(1.0, float(residuals @ residuals) / free, float(np.trace(inverse @ scatter) / np.trace(inverse @ information)))
    return inverse @ (factor * information + prior) @ inverse, f"errors from the noise, widened {np.sqrt(factor):.1f} times"


def _scatter(residuals: Floats, jacobian: Floats, stroke_of_row: NDArray[np.intp]) -> tuple[Floats, int]:
    """Sum over strokes of the outer product of each stroke's gradient with respect to the parameters."""
    strokes = int(stroke_of_row.max()) + 1
    pulls = np.array([jacobian[stroke_of_row == s].T @ residuals[stroke_of_row == s] for s in range(strokes)])
    # The factor corrects for few clusters.
    return pulls.T @ pulls * strokes / max(strokes - 1, 1), strokes
