"""How far model and recording may lie apart before something is missing: noise, what differs from stroke to stroke, a model that is a
little wrong everywhere.

    C = diag(noise^2) + B B^T + s^2 K

B holds what one standard deviation of each scattering quantity does, drawn anew for every condition. K is the covariance of a smooth
discrepancy in proportion to the signal's size, alike in part between conditions (Kennedy and O'Hagan, J. R. Statist. Soc. B 63 (2001)
425); s is its size, integrated over when hypotheses are compared.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cholesky, solve_triangular

from rfca_rig.diagnosis.rows import Rows

Floats = NDArray[np.float64]

SMOOTH_OVER = 0.06  # of the way from touchdown to valley: some 50 ms
SHARED = 0.5  # correlation of the discrepancy between conditions
FLOOR = 1e-3  # of the discrepancy's variance is not smooth


@dataclass(frozen=True)
class Whitening:
    """The lower Cholesky factor of C at one s, and the log of the determinant of C."""

    s: float
    factor: Floats
    log_det: float

    def __call__(self, values: Floats) -> Floats:
        """L^-1 values, of rows (m,) or columns (m, p)."""
        return np.asarray(solve_triangular(self.factor, values, lower=True, check_finite=False))


def discrepancy(rows: Rows) -> Floats:
    """K (m, m): the covariance of a discrepancy of relative size 1."""
    same_signal = (rows.signal[:, None] == rows.signal) & (rows.experiment[:, None] == rows.experiment)
    same_way = (rows.phase[:, None] == rows.phase) | (rows.experiment == "dynamic")[:, None]
    together = np.where(rows.condition[:, None] == rows.condition, 1.0, SHARED)
    length = np.where(rows.experiment == "dynamic", SMOOTH_OVER, 1.0)
    apart = (rows.progress[:, None] - rows.progress) / np.maximum(length[:, None], length)
    smooth = np.exp(-0.5 * apart**2) * together * (same_signal & same_way)
    return np.asarray(rows.scale[:, None] * smooth * rows.scale + np.diag(FLOOR * rows.scale**2 + rows.jolt**2))


def whitening_of(rows: Rows, scatter: Floats, kernel: Floats, s: float) -> Whitening:
    """The whitening at s; `scatter` (m, k) as B, `kernel` from `discrepancy`."""
    covariance = s**2 * kernel + scatter @ scatter.T + np.diag(rows.noise**2)
    factor = cholesky(covariance, lower=True, overwrite_a=True, check_finite=False)
    return Whitening(s, factor, 2.0 * float(np.log(np.diag(factor)).sum()))
