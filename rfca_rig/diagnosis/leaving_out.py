"""What a hypothesis foretells of each condition when it is fitted to the others.

With P the inverse covariance of all rows, what the rows o add to what the others say is normal with precision P_oo about what the
others foretell of them. So the information of the others is J^T P J - (P J)_o^T P_oo^-1 (P J)_o, and no covariance but P is needed.
"""

from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cho_factor, cho_solve

from rfca_rig.diagnosis.covariance import AtError
from rfca_rig.diagnosis.linear import Linear

Floats = NDArray[np.float64]


def foretold_apart(linear: Linear, whitening: AtError, condition: NDArray[np.intp], left_out: Iterable[int]) -> Floats:
    """Measured less foretold (m,), row by row in the signals' units, each condition of `left_out` foretold from all other rows.

    Rows of other conditions are 0.
    """
    both = np.column_stack([linear.slope, linear.target])
    turn = whitening.basis.turn / np.sqrt(1.0 + whitening.s**2 * whitening.basis.strength)[:, None]
    weighed = turn.T @ (turn @ both)
    unknowns = linear.slope.shape[1]
    information = linear.slope.T @ weighed
    apart = np.zeros(len(linear.target))
    for number in left_out:
        out = np.flatnonzero(condition == number)
        own = np.ascontiguousarray(turn[:, out])
        taken = weighed[out, :unknowns].T @ cho_solve(cho_factor(own.T @ own, check_finite=False), weighed[out], check_finite=False)
        others = information - taken
        mean = np.linalg.solve(others[:, :unknowns] + np.eye(unknowns), others[:, unknowns])
        apart[out] = linear.target[out] - linear.slope[out] @ mean
    return apart
