"""Fits the curve of one form to the stages: touching ends, errors and coefficients are found
together.

Which link ends touch is found by active sets: assume, solve, check. Noise is estimated from the
stages themselves.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize

from rfca_rig.analysis.torque_rotation.balance import Balance, Group
from rfca_rig.analysis.torque_rotation.bases import Basis
from rfca_rig.analysis.torque_rotation.gauss_helmert import (
    Adjustment,
    NotConverged,
    Point,
    adjust,
    linearise_groups,
    rewhiten_groups,
    stack_rows,
)
from rfca_rig.analysis.torque_rotation.stages import (
    MISSING_STD_RAD,
    SHAFT_STD_RAD,
    StageData,
    SystematicErrors,
)
from rfca_rig.errors import SimulationFailed
from rfca_rig.model.hinge_springs import bending_torque_Nm
from rfca_rig.model.parameters import RigModel

Floats = NDArray[np.float64]
Ends = tuple[int, ...]

# Standard deviations of the rack's height that an end near the floor may be off.
HEIGHT_MARGIN_STD = 3.0
# Standard deviations of fz and of its tare from which on a load is certain.
LOADED_STD = 4.0
# Above the floor: an end that may touch, as far as a photo shows. Including an end in the air does
# no harm.
NEAR_M = 6e-3
MIN_DEPTH_M = 1e-4
MAX_CONTACT_ROUNDS = 6

# Initial error of a hinge angle in a photo.
USUAL_HINGE_DEG = 0.15
# Prior deviations of the logarithms.
LOG_PRIOR_STD = {"hinge": 2.0, "stated": 0.7, "force": 1.5}
FIRST_LOG_STEP = {"hinge": 0.4, "stated": 0.3, "force": -0.7}
# Accuracy of the search, in logarithms of the noise and in log-likelihood.
SEARCH_TOLERANCE = 0.02
LEAST_HINGE_RAD = 2e-5
LEAST_FACTOR = 0.02

MAX_ROUNDS = 4
# Change of the logarithm of a noise below which it counts as the same.
LOG_TOLERANCE = 0.02


def solve_contacts(
    balance: Balance, data: StageData, C: Floats, start: Point, ends: Sequence[Ends]
) -> tuple[Adjustment, tuple[Ends, ...]]:
    """Adjust the stages and find the ends that may touch, beginning with `ends` (S,).

    Parameters
    ----------
    balance, data
        The conditions and the stages.
    C
        (S, m, m) covariance of the measured values.
    start
        Point to begin from.
    ends
        (S,) ends that may touch at each stage.

    Raises
    ------
    SimulationFailed
        Where no balance is found.
    """
    tried = set()
    point = start
    for _ in range(MAX_CONTACT_ROUNDS):
        try:
            adjusted = adjust(balance, group_by_contacts(data, ends), data.measured, C, point)
        except NotConverged as error:
            raise SimulationFailed(
                f"no balance of moments is found for these {len(data.stages)} stages; "
                f"{data.label(error.row)} is farthest from one: look "
                "for a wrong sign, unit or height there or in all stages, or for a "
                "slipped decimal point in the leg"
            ) from None
        # A set that was tried before would repeat itself for ever.
        tried.add(tuple(ends))
        depth = _depths(balance, data, adjusted.point.z, adjusted.point.p)
        deep = (np.flatnonzero(row > MIN_DEPTH_M).tolist() for row in depth)
        contacts = tuple(
            tuple(sorted({*stage_ends, *more})) for stage_ends, more in zip(ends, deep, strict=True)
        )
        if contacts in tried:
            break
        ends = contacts
        point = make_start_point(balance, data, adjusted.point, contacts)
    return adjusted, tuple(ends)


def guess_contacts(balance: Balance, data: StageData, p: Floats) -> tuple[Ends, ...]:
    """Ends (S,) that the photo shows in or near the floor; always the lowest one where the sensor
    measures a load.

    `p` (P,) are the unknowns at the start.
    """
    depth = _depths(balance, data, data.measured, p)
    load_N = balance.weight_N - data.measured[:, data.hinges + 2]
    pressed = load_N > LOADED_STD * np.hypot(data.force_std[:, 1], data.sample_noise[1])
    heights = [
        systematic_error.std
        for systematic_error in balance.systematic_errors.errors
        if systematic_error.name.startswith("height_")
    ]
    # An end that is included but does not press costs nothing; one that is missed would falsify the
    # balance.
    near_m = NEAR_M + HEIGHT_MARGIN_STD * max(heights, default=0.0)
    low = (depth > -near_m) | (pressed[:, None] & (depth == depth.max(axis=1, keepdims=True)))
    return tuple(tuple(np.flatnonzero(row).tolist()) for row in low)


def find_pressing_ends(adjusted: Adjustment, stages: int) -> tuple[Ends, ...]:
    """The ends (S,) that press on the floor."""
    pressing_ends: list[Ends] = [()] * stages
    for group, c in zip(adjusted.groups, adjusted.point.c, strict=True):
        for row, depths_m in zip(group.rows, c, strict=True):
            pressing_ends[row] = tuple(
                end for end, deep_m in zip(group.ends, depths_m, strict=False) if deep_m > 0.0
            )
    return tuple(pressing_ends)


def make_start_point(
    balance: Balance, data: StageData, point: Point, ends: Sequence[Ends]
) -> Point:
    """The same angles and curve; the ends share the sensor's load in proportion to their
    depth^1.5, as Hertz does.
    """
    depth = _depths(balance, data, point.z, point.p)
    h = data.hinges
    stiffness = balance.rig.ground.stiffness_N_per_m1p5
    c = []
    for group in group_by_contacts(data, ends):
        pressed = np.maximum(depth[group.rows][:, list(group.ends)], MIN_DEPTH_M) ** 1.5
        share = pressed / pressed.sum(axis=1, keepdims=True)
        N = share * np.maximum(balance.weight_N - data.measured[group.rows, h + 2], 1e-2)[:, None]
        # Depth from Hertz, d = (N / k)^(2/3), and friction that balances fy.
        c.append(
            np.concatenate(
                [
                    (N / stiffness) ** (2.0 / 3.0),
                    -share * data.measured[group.rows, h + 1][:, None],
                ],
                axis=1,
            )
        )
    return replace(point, c=tuple(c))


def group_by_contacts(data: StageData, ends: Sequence[Ends]) -> tuple[Group, ...]:
    """Groups of stages with the same ends near the floor, in the order of their first stage."""
    height = np.searchsorted(data.heights_m, data.height_m)
    groups = []
    for pattern in dict.fromkeys(ends):
        rows = np.array(
            [i for i, stage_ends in enumerate(ends) if stage_ends == pattern], dtype=np.intp
        )
        groups.append(Group(rows, pattern, data.height_m[rows], height[rows], data.recording[rows]))
    return tuple(groups)


def _depths(balance: Balance, data: StageData, z: Floats, p: Floats) -> Floats:
    group = group_by_contacts(data, [()] * len(z))[0]
    return balance.depth_m(balance.correct_readings(z, p, data.recording), p, group)


@dataclass(frozen=True)
class Errors:
    """Noise model of a stage, m = h + 4 measured values.

    `hinge_std_rad` applies where no error of an angle was stated. The factors multiply stated
    errors, and the expected error of a mean force. With `chained`, neighbouring angles are
    correlated through the marks that they share; else each is independent.
    """

    hinge_std_rad: float = float(np.radians(USUAL_HINGE_DEG))
    stated_factor: float = 1.0
    force_factor: float = 1.0
    chained: bool = False

    def covariance(self, data: StageData, link_lengths_m: Sequence[float]) -> Floats:
        """Covariance (S, h + 4, h + 4) of the measured values at each stage."""
        h = data.hinges
        std = np.where(data.unstated, self.hinge_std_rad, self.stated_factor * data.hinge_std_rad)
        std = np.where(data.seen, std, MISSING_STD_RAD)
        if self.chained:
            correlation = mark_correlation(link_lengths_m)
        else:
            correlation = np.eye(h)
        C = np.zeros((len(std), h + 4, h + 4))
        C[:, :h, :h] = std[:, :, None] * correlation * std[:, None, :]
        others = np.concatenate(
            [np.full((len(std), 1), SHAFT_STD_RAD), self.force_factor * data.force_std], axis=1
        )
        places = np.arange(h, h + 4)
        C[:, places, places] = others**2
        return C

    def scale_by_logs(self, steps: dict[str, float]) -> "Errors":
        """The same with these logarithms added. Limits from below, because computed tables have
        no noise and the adjustment needs some.
        """
        return Errors(
            max(self.hinge_std_rad * float(np.exp(steps.get("hinge", 0.0))), LEAST_HINGE_RAD),
            max(self.stated_factor * float(np.exp(steps.get("stated", 0.0))), LEAST_FACTOR),
            max(self.force_factor * float(np.exp(steps.get("force", 0.0))), LEAST_FACTOR),
            self.chained,
        )

    def misfit(self) -> float:
        """Minus the log prior of these errors, up to a constant."""
        usual = float(np.radians(USUAL_HINGE_DEG))
        logs = {
            "hinge": self.hinge_std_rad / usual,
            "stated": self.stated_factor,
            "force": self.force_factor,
        }
        return sum(
            0.5 * (float(np.log(value)) / LOG_PRIOR_STD[name]) ** 2 for name, value in logs.items()
        )


def mark_correlation(link_lengths_m: Sequence[float]) -> Floats:
    """Correlation (h, h) of hinge angles from marks at every hinge and at the tip with equal
    errors: neighbouring angles share two marks.
    """
    n = len(link_lengths_m)
    # A link's angle is the difference of its two marks over its length; a hinge angle is the
    # difference of two links.
    links = (np.eye(n, n + 1, k=1) - np.eye(n, n + 1)) / np.array(link_lengths_m)[:, None]
    hinges = np.diff(links, axis=0)
    covariance = hinges @ hinges.T
    std = np.sqrt(np.diag(covariance))
    return np.asarray(covariance / np.outer(std, std))


def estimate_noise(data: StageData, adjusted: Adjustment, errors: Errors) -> tuple[Errors, float]:
    """Most probable errors given the stages, with curve and unknowns integrated out (REML), and
    their log-likelihood including the prior.
    """
    lengths = adjusted.balance.rig.leg.link_lengths_m
    measured = data.measured
    groups = adjusted.groups
    # The conditions stay linearised at the solution, so that each trial costs only linear algebra.
    parts = linearise_groups(
        adjusted.balance, groups, measured, errors.covariance(data, lengths), adjusted.point
    )
    moved = measured - adjusted.point.z
    unstated = data.unstated & data.seen
    learnable = {"hinge": unstated.any(), "stated": (data.seen & ~unstated).any(), "force": True}
    names = [name for name, is_learnable in learnable.items() if is_learnable]

    def cost(logs: Floats) -> float:
        trial = errors.scale_by_logs(dict(zip(names, logs, strict=True)))
        rows = stack_rows(
            adjusted.balance,
            rewhiten_groups(parts, groups, moved, trial.covariance(data, lengths)),
            adjusted.point.p,
        )
        return trial.misfit() - rows.log_likelihood()

    first = np.concatenate(
        [np.zeros((1, len(names))), np.diag([FIRST_LOG_STEP[name] for name in names])]
    )
    # At most three unknowns: a simplex search needs no derivatives.
    optimum = minimize(
        cost,
        first[0],
        method="Nelder-Mead",
        options={"xatol": SEARCH_TOLERANCE, "fatol": SEARCH_TOLERANCE, "initial_simplex": first},
    )
    return errors.scale_by_logs(dict(zip(names, optimum.x, strict=True))), -float(optimum.fun)


@dataclass(frozen=True)
class CurveFit:
    """A curve with the errors it was found with; `log_likelihood` is that of the errors, `ends`
    (S,) are those that touch.
    """

    adjusted: Adjustment
    errors: Errors
    log_likelihood: float
    ends: tuple[Ends, ...]


def fit_curve(
    data: StageData,
    rig: RigModel,
    basis: Basis,
    systematic_errors: SystematicErrors,
    errors: Errors,
    extra: Floats | None = None,
    learn: bool = True,
) -> CurveFit:
    """Fit the coefficients by least squares with errors in all measured values.

    Parameters
    ----------
    data, rig
        The stages and the nominal model.
    basis
        Form of the curve.
    systematic_errors
        Their priors.
    errors
        Noise to begin from.
    extra
        (S, h, e) further columns of hinge torque.
    learn
        Whether the noise is estimated from the stages.

    Raises
    ------
    SimulationFailed
        Where no balance is found.
    """
    if extra is None:
        extra = np.zeros((len(data.measured), data.hinges, 0))
    balance = Balance(rig, basis, systematic_errors, extra)
    p = np.zeros(balance.curve_size + len(systematic_errors.errors))
    # Gauss-Newton begins at the nominal curve, with all systematic errors at 0: the coefficients
    # nearest to the nominal law over the angles of the stages.
    phi = np.linspace(*_range(data), 100)
    torque = bending_torque_Nm(rig.leg, phi)
    p[: basis.size] = np.asarray(np.linalg.lstsq(basis.columns(phi), torque, rcond=None)[0])
    ends = guess_contacts(balance, data, p)
    point = make_start_point(balance, data, Point(data.measured.copy(), (), p), ends)
    for _ in range(MAX_ROUNDS):
        adjusted, ends = solve_contacts(
            balance, data, errors.covariance(data, rig.leg.link_lengths_m), point, ends
        )
        if not learn:
            return CurveFit(
                adjusted, errors, adjusted.log_likelihood, find_pressing_ends(adjusted, len(ends))
            )
        # Noise and curve depend on each other, so both are estimated in turn until the noise no
        # longer changes.
        before = errors
        (errors, likelihood) = estimate_noise(data, adjusted, errors)
        point = adjusted.point
        if _is_same(before, errors):
            break
    adjusted, ends = solve_contacts(
        balance, data, errors.covariance(data, rig.leg.link_lengths_m), point, ends
    )
    return CurveFit(adjusted, errors, likelihood, find_pressing_ends(adjusted, len(ends)))


def _range(data: StageData) -> tuple[float, float]:
    angles = data.measured[:, : data.hinges][data.seen]
    return float(angles.min()), float(angles.max())


def _is_same(a: Errors, b: Errors) -> bool:
    pairs = (
        (a.hinge_std_rad, b.hinge_std_rad),
        (a.stated_factor, b.stated_factor),
        (a.force_factor, b.force_factor),
    )
    return max(abs(float(np.log(x / y))) for x, y in pairs) < LOG_TOLERANCE
