"""Tests of the curve's assumptions: the form of the law, equal hinges, no hysteresis, values as
in the nominal model.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.stats import chi2

from rfca_rig.analysis.torque_rotation.bases import TorqueCurve
from rfca_rig.analysis.torque_rotation.gauss_helmert import Adjustment, linearise_groups, stack_rows
from rfca_rig.analysis.torque_rotation.recovery import CurveFit
from rfca_rig.analysis.torque_rotation.stages import StageData, rest_name

Floats = NDArray[np.float64]

# Probability of a gain this large where the law holds, below which the law is rejected.
MIN_P_VALUE = 1e-3
# Share of the largest torque, below which the law is the better description although it is not
# exact. The difference is in the band.
NEGLIGIBLE_SHARE = 0.005
# In standard deviations: of some hundred readings none is this far off by chance.
OUTLIER_STD = 6.0
# In standard deviations.
SIGNIFICANT_STD = 4.0


@dataclass(frozen=True)
class FormCheck:
    """Gain of splines over the law with the same errors: `gain` in chi2 for `more` coefficients,
    `p_value` of it where the law holds.

    The curves differ most at `at_rad`, by `apart_Nm`, or `apart_relative` of the largest torque.
    """

    gain: float
    more: int
    p_value: float
    at_rad: float
    apart_Nm: float
    apart_relative: float

    @property
    def is_rejected(self) -> bool:
        return self.p_value < MIN_P_VALUE

    @property
    def holds(self) -> bool:
        # With many stages even a tiny departure is significant; it matters only above
        # NEGLIGIBLE_SHARE.
        return not self.is_rejected or abs(self.apart_relative) < NEGLIGIBLE_SHARE


@dataclass(frozen=True)
class HingeCheck:
    """Relative stiffness of one hinge above the common curve, with one standard deviation;
    hinges count from 2.
    """

    hinge: int
    stiffer: float
    std: float

    @property
    def significance(self) -> float:
        """In standard deviations."""
        return abs(self.stiffer) / self.std

    @property
    def is_significant(self) -> bool:
        return self.significance > SIGNIFICANT_STD


@dataclass(frozen=True)
class RestAngles:
    """Rest angles (h,) [rad] fitted beside a curve, with their covariance (h, h).

    `with_stiffness` is the correlation of their mean with the curve's stiffness at rest: near +-1
    the data do not separate the two.
    """

    rest_rad: Floats
    covariance: Floats
    with_stiffness: float

    @property
    def std_rad(self) -> Floats:
        """Standard deviation (h,) of each hinge by itself."""
        return np.asarray(np.sqrt(np.diag(self.covariance)))

    @property
    def common_std_rad(self) -> float:
        """Standard deviation of the mean of all hinges."""
        return float(np.sqrt(self.covariance.mean()))


@dataclass(frozen=True)
class RestCheck:
    """Rest angle of one hinge, or of all where `hinge` is None, from the nominal one, with one
    standard deviation [rad].
    """

    hinge: int | None
    rest_rad: float
    std_rad: float

    @property
    def significance(self) -> float:
        """In standard deviations."""
        return abs(self.rest_rad) / self.std_rad

    @property
    def is_significant(self) -> bool:
        return self.significance > SIGNIFICANT_STD


@dataclass(frozen=True)
class BendingLoop:
    """Half the height of the hysteresis loop, one standard deviation, and the number of angles
    reached by bending and by unbending.
    """

    half_Nm: float
    std_Nm: float
    bending: int
    unbending: int

    @property
    def seen(self) -> bool:
        return abs(self.half_Nm) > SIGNIFICANT_STD * self.std_Nm


@dataclass(frozen=True)
class EstimatedSystematicError:
    """Estimate of a systematic error, in its unit for a reader; `pull` is the estimate in prior
    standard deviations, `remedy` what to do where it is implausible.
    """

    words: str
    unit: str
    value: float
    std: float
    prior_std: float
    pull: float
    remedy: str

    @property
    def is_implausible(self) -> bool:
        """Whether it is farther from its nominal value than its prior allows."""
        return abs(self.pull) > SIGNIFICANT_STD


@dataclass(frozen=True)
class Outlier:
    """A reading that is `pull` standard deviations from the value that the balance asks for: by
    `off`, in `unit`.
    """

    label: str
    words: str
    off: float
    unit: str
    pull: float


def find_outliers(found: CurveFit, data: StageData) -> tuple[Outlier, ...]:
    """Outliers: readings that noise does not explain, the worst first."""
    C = found.errors.covariance(data, found.adjusted.balance.rig.leg.link_lengths_m)
    off = data.measured - found.adjusted.point.z
    pulls = off / np.sqrt(np.diagonal(C, axis1=1, axis2=2))
    names = [(f"hinge {i + 2}", "degrees", np.degrees(1.0)) for i in range(data.hinges)]
    names += [
        ("the shaft's angle", "degrees", np.degrees(1.0)),
        ("fy", "N", 1.0),
        ("fz", "N", 1.0),
        ("tx", "N m", 1.0),
    ]
    far = sorted(
        np.argwhere(np.abs(pulls) > OUTLIER_STD).tolist(), key=lambda index: -abs(pulls[*index])
    )
    return tuple(
        Outlier(
            data.label(row),
            names[column][0],
            float(names[column][2] * off[row, column]),
            names[column][1],
            float(pulls[row, column]),
        )
        for row, column in far
    )


def compare_forms(
    law: CurveFit, free: CurveFit, law_curve: TorqueCurve, free_curve: TorqueCurve
) -> FormCheck:
    """Compare two solutions with the same errors, at the same angles of the hinges, whatever
    their rest angles.
    """
    gain = max(law.adjusted.chi2 - free.adjusted.chi2, 0.0)
    more = free.adjusted.balance.basis.size - law.adjusted.balance.basis.size
    grid = free_curve.grid_rad()
    # Each curve counts angles from its own rest, so the grid is shifted by the difference.
    rests = [fit.adjusted.balance.rest_rad(fit.adjusted.point.p).mean() for fit in (law, free)]
    by_law = law_curve.torque_Nm(grid + rests[1] - rests[0])[0]
    by_free = free_curve.torque_Nm(grid)[0]
    worst = int(np.argmax(np.abs(by_law - by_free)))
    apart = float(by_law[worst] - by_free[worst]) * law_curve.bends
    scale = float(np.abs(by_free).max()) or 1.0
    return FormCheck(
        gain, more, float(chi2.sf(gain, max(more, 1))), float(grid[worst]), apart, apart / scale
    )


def check_hinges(found: CurveFit, data: StageData, curve: TorqueCurve) -> tuple[HingeCheck, ...]:
    """Test for each hinge whether it is stiffer than the curve that the others share."""
    torque = curve.torque_Nm(from_rest_rad(found, data).ravel())[0].reshape(-1, data.hinges)
    # The curve's own torque at one hinge alone is the column for a relative change of its
    # stiffness.
    columns = torque[:, :, None] * np.eye(data.hinges)
    return tuple(
        HingeCheck(j + 2, value, std)
        for j, (value, std) in enumerate(_score_columns(found, data, columns))
    )


def from_rest_rad(found: CurveFit, data: StageData) -> Floats:
    """Angles (S, h) of the hinges from the rest angles found."""
    point = found.adjusted.point
    balance = found.adjusted.balance
    return np.asarray(point.z[:, : data.hinges] - balance.rest_rad(point.p))


def check_rest_angles(
    found: CurveFit, data: StageData, curve: TorqueCurve
) -> tuple[RestCheck, ...]:
    """Test for each hinge, and for all together, whether it rests elsewhere; no tests where rest
    angles are unknowns already.
    """
    if found.adjusted.balance.systematic_errors.place(rest_name(0)) is not None:
        return ()
    stiffness = curve.stiffness_Nm_per_rad(from_rest_rad(found, data).ravel())[0].reshape(
        -1, data.hinges
    )
    # A shift of the rest angle changes the torque by minus the stiffness, to first order.
    single = -stiffness[:, :, None] * np.eye(data.hinges)
    estimates = _score_columns(
        found, data, np.concatenate([single, -stiffness[:, :, None]], axis=2)
    )
    # Hinges are numbered from 2; None stands for all together.
    hinges = (*range(2, data.hinges + 2), None)
    return tuple(
        RestCheck(hinge, value, std) for hinge, (value, std) in zip(hinges, estimates, strict=True)
    )


def estimate_rest_angles(found: CurveFit, widened: float) -> RestAngles | None:
    """The rest angles with their covariance, errors multiplied by `widened`; None where they
    count as exact.
    """
    adjusted = found.adjusted
    first = adjusted.balance.systematic_errors.place(rest_name(0))
    hinges = adjusted.balance.L.size - 1
    if first is None:
        return None
    curve = adjusted.balance.basis
    covariance = adjusted.covariance
    places = slice(
        adjusted.balance.curve_size + first, adjusted.balance.curve_size + first + hinges
    )
    slope = curve.slopes(np.zeros(1))[0]
    with_slope = float(slope @ covariance[: curve.size, places].mean(axis=1))
    variances = float(slope @ covariance[: curve.size, : curve.size] @ slope) * float(
        covariance[places, places].mean()
    )
    rest_rad = adjusted.balance.rest_rad(adjusted.point.p)
    return RestAngles(
        rest_rad, widened**2 * covariance[places, places], with_slope / float(np.sqrt(variances))
    )


def _score_columns(fit: CurveFit, data: StageData, columns: Floats) -> list[tuple[float, float]]:
    """Value and standard deviation of each further column of hinge torque (S, h, e), tested one
    at a time beside all other unknowns.
    """
    adjusted = fit.adjusted
    C = fit.errors.covariance(data, adjusted.balance.rig.leg.link_lengths_m)
    rows = stack_rows(
        adjusted.balance,
        linearise_groups(
            adjusted.balance, adjusted.groups, data.measured, C, adjusted.point, columns
        ),
        adjusted.point.p,
    )
    # Columns of equal size keep the least squares well conditioned.
    scale = np.linalg.norm(rows.matrix, axis=0)
    results = []
    for column in rows.extra.T:
        known = rows.matrix / scale
        # Only the part that the other unknowns cannot explain carries information (Frisch-Waugh).
        residual = column - known @ np.linalg.lstsq(known, column, rcond=None)[0]
        information = float(residual @ residual)
        if information > 0.0:
            results.append((-float(residual @ rows.right) / information, information**-0.5))
        else:
            results.append((0.0, np.inf))
    return results


def estimate_loop(found: CurveFit, data: StageData) -> BendingLoop | None:
    """The hysteresis loop from the first further column, where `found` has `data.turned` for
    one; None where no hinge turned back.
    """
    bending = data.turned * np.sign(data.measured[:, : data.hinges])
    back = int((bending < 0).sum())
    if not back or not found.adjusted.balance.extra.shape[2]:
        return None
    index = found.adjusted.balance.basis.size
    std = float(np.sqrt(found.adjusted.covariance[index, index]))
    return BendingLoop(float(found.adjusted.point.p[index]), std, int((bending > 0).sum()), back)


def list_estimated_errors(adjusted: Adjustment) -> tuple[EstimatedSystematicError, ...]:
    """Estimates of all systematic errors."""
    first = adjusted.balance.curve_size
    systematic_errors = adjusted.balance.systematic_errors.errors
    values = adjusted.point.p[first:]
    std = np.sqrt(np.diag(adjusted.covariance))[first:]
    return tuple(
        EstimatedSystematicError(
            d.words,
            d.unit,
            *d.convert(float(v), float(s)),
            d.scale * d.std,
            float(v) / d.std,
            d.remedy,
        )
        for d, v, s in zip(systematic_errors, values, std, strict=True)
    )
