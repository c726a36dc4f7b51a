"""Average of two forms of the curve, one of which contains the other: what is not known about the
form is in the band.

The form with fewer coefficients is nearly right at best, and the richer one follows every ripple of
the noise. The truth is taken to depart from the first by a share w of the difference d between
both. With the prior of a g-prior, w = g / (1 + g), its posterior for a gain of chi2 by m more
coefficients is

    p(w) proportional to (1 - w)^(m/2) exp(-(1 - w) gain / 2),    0 <= w <= 1,

where w is uniform a priori (the hyper-g prior with a = 4). The covariance about the first form is

    (1 - E w) C_first + E w C_second + E w^2 d d^T,

and about the second one the same with the share 1 - w. It does not matter whether a test accepts
the first form: w grows steadily with the gain.

References
----------
Zellner (1986), in: Bayesian inference and decision techniques, 233. Liang, Paulo, Molina, Clyde and
Berger, J. Am. Stat. Assoc. 103 (2008) 410.
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.special import gammainc

from rfca_rig.analysis.torque_rotation.bases import Basis, SplineThroughRest, TorqueCurve
from rfca_rig.analysis.torque_rotation.checks import FormCheck

Floats = NDArray[np.float64]

# Below this half gain the posterior is the prior times (1 - w)^(m/2), and its moments are 0 / 0.
LEAST_HALF_GAIN = 1e-9


@dataclass(frozen=True)
class DepartureShare:
    """Posterior mean and mean square of the share of a difference between two forms."""

    mean: float
    mean_square: float

    @property
    def of_other_form(self) -> "DepartureShare":
        """The same of 1 minus the share."""
        return DepartureShare(1.0 - self.mean, 1.0 - 2.0 * self.mean + self.mean_square)


def share_of_richer_form(form: FormCheck) -> DepartureShare:
    """How far the truth is from the form with fewer coefficients towards the richer one."""
    shape = 0.5 * max(form.more, 1) + 1.0
    half_gain = max(0.5 * form.gain, LEAST_HALF_GAIN)
    # 1 - w has a gamma distribution that is cut off at 1.
    whole = float(gammainc(shape, half_gain))
    mean = shape / half_gain * float(gammainc(shape + 1.0, half_gain)) / whole
    mean_square = (
        shape * (shape + 1.0) / half_gain**2 * float(gammainc(shape + 2.0, half_gain)) / whole
    )
    return DepartureShare(mean, mean_square).of_other_form


@dataclass(frozen=True)
class JoinedForms:
    """Columns of two forms beside each other; the second counts angles from `shift_rad` before the
    rest of the first.
    """

    first: Basis
    second: Basis
    shift_rad: float = 0.0

    @property
    def size(self) -> int:
        return self.first.size + self.second.size

    def columns(self, phi_rad: Floats) -> Floats:
        """Columns (m, size) for angles (m,)."""
        second = self.second.columns(phi_rad + self.shift_rad)
        return np.concatenate([self.first.columns(phi_rad), second], axis=-1)

    def slopes(self, phi_rad: Floats) -> Floats:
        """Derivatives (m, size) of the columns at angles (m,)."""
        second = self.second.slopes(phi_rad + self.shift_rad)
        return np.concatenate([self.first.slopes(phi_rad), second], axis=-1)


def with_departure(
    curve: TorqueCurve, other: TorqueCurve, share_of_other: DepartureShare, shift_rad: float = 0.0
) -> TorqueCurve:
    """The same curve with the covariance of the average of both forms about it.

    Parameters
    ----------
    curve, other
        The curve that is shown, and the one in the other form.
    share_of_other
        How far the truth is from `curve` towards `other`.
    shift_rad
        Rest angle of `curve` minus that of `other`.
    """
    size = curve.basis.size
    basis = JoinedForms(curve.basis, other.basis, shift_rad)
    # The difference as coefficients of the columns of both.
    difference = np.concatenate([-curve.coefficients, other.coefficients])
    covariance = share_of_other.mean_square * np.outer(difference, difference)
    covariance[:size, :size] += (1.0 - share_of_other.mean) * curve.covariance
    covariance[size:, size:] += share_of_other.mean * other.covariance
    coefficients = np.concatenate([curve.coefficients, np.zeros(other.basis.size)])
    return replace(curve, basis=basis, coefficients=coefficients, covariance=covariance)


def at_knots(curve: TorqueCurve, basis: SplineThroughRest) -> TorqueCurve:
    """A curve in the basis whose coefficients are its torques at the knots, with the covariance
    that `curve` has there.
    """
    # Knots are above zero. The curve counts on the side to which the hinges bend.
    columns = curve.bends * curve.basis.columns(curve.bends * np.array(basis.knots_rad))
    return replace(
        curve,
        basis=basis,
        coefficients=columns @ curve.coefficients,
        covariance=columns @ curve.covariance @ columns.T,
    )
