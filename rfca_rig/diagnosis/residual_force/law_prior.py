"""Prior of a measured law: it is smooth, and of a plausible size.

D are second differences over k knots, and Q = D^T D / rho^2 + 1 / k. The covariance of the values is size^2 Q^-1. With rho = 0.03 the law
is nearly straight, with rho = 1 it may have any course.

References: Rasmussen and Williams, Gaussian Processes for Machine Learning (2006), chapter 5; Lang and Brezger, J. Comput. Graph. Statist.
13 (2004) 183 (random-walk priors for the coefficients of splines).
"""

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

SIZES = (0.1, 0.3, 1.0, 3.0, 10.0)  # of a plausible value; a decade either way of what a rig may have
ROUGHNESS = (0.03, 0.1, 0.3, 1.0)
NONE = 1e-3  # of a law's size: nothing, where it is known to be none


def prior_root(knots: Floats, size: float, roughness: float, zero_at_zero: bool = False) -> Floats:
    """Root (k, k) of the prior covariance of the values at the knots (k,), columns from the least free direction to the freest.

    With `zero_at_zero` the law is known to be zero at a knot that is 0.
    """
    count = len(knots)
    bend = np.diff(np.eye(count), 2, axis=0) / roughness
    known = np.diag((np.abs(knots) < 1e-9) / NONE**2) if zero_at_zero else np.zeros((count, count))
    values, vectors = np.linalg.eigh(bend.T @ bend + np.eye(count) / count + known)
    return np.asarray(size * vectors / np.sqrt(values))
