"""Noise of angles and forces, estimated from the stages themselves."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize

from rfca_rig.analysis.torque_rotation.gauss_helmert import Adjustment, linearise_groups, rewhiten_groups, stack_rows
from rfca_rig.analysis.torque_rotation.stages import MISSING_STD_RAD, SHAFT_STD_RAD, StageData

Floats = NDArray[np.float64]

# Initial error of a hinge angle in a photo.
USUAL_HINGE_DEG = 0.15
# Prior deviations of the logarithms.
LOG_PRIOR_STD = {"hinge": 2.0, "stated": 0.7, "force": 1.5}
FIRST_LOG_STEP = {"hinge": 0.4, "stated": 0.3, "force": -0.7}
# Accuracy of the search, in logarithms of the noise and in log-likelihood.
SEARCH_TOLERANCE = 0.02
LEAST_HINGE_RAD, LEAST_FACTOR = 2e-5, 0.02


@dataclass(frozen=True)
class Errors:
    """Noise model of a stage, m = h + 4 measured values.

    `hinge_std_rad` applies where no error of an angle was stated. The factors multiply stated errors, and the expected error of a mean
    force. With `chained`, neighbouring angles are correlated through the marks that they share; else each is independent.
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
        correlation = mark_correlation(link_lengths_m) if self.chained else np.eye(h)
        C = np.zeros((len(std), h + 4, h + 4))
        C[:, :h, :h] = std[:, :, None] * correlation * std[:, None, :]
        others = np.concatenate([np.full((len(std), 1), SHAFT_STD_RAD), self.force_factor * data.force_std], axis=1)
        places = np.arange(h, h + 4)
        C[:, places, places] = others**2
        return C

    def scaled_by_logs(self, steps: dict[str, float]) -> "Errors":
        """The same with these logarithms added. Limits from below, because computed tables have no noise and the adjustment needs some."""
        return Errors(
            max(self.hinge_std_rad * float(np.exp(steps.get("hinge", 0.0))), LEAST_HINGE_RAD),
            max(self.stated_factor * float(np.exp(steps.get("stated", 0.0))), LEAST_FACTOR),
            max(self.force_factor * float(np.exp(steps.get("force", 0.0))), LEAST_FACTOR),
            self.chained,
        )

    def misfit(self) -> float:
        """Minus the log prior of these errors, up to a constant."""
        usual = float(np.radians(USUAL_HINGE_DEG))
        logs = {"hinge": self.hinge_std_rad / usual, "stated": self.stated_factor, "force": self.force_factor}
        return sum(0.5 * (float(np.log(value)) / LOG_PRIOR_STD[name]) ** 2 for name, value in logs.items())


def mark_correlation(link_lengths_m: Sequence[float]) -> Floats:
    """Correlation (h, h) of hinge angles from marks at every hinge and at the tip with equal errors: neighbouring angles share two
    marks.
    """
    n = len(link_lengths_m)
    # A link's angle is the difference of its two marks over its length; a hinge angle is the difference of two links.
    links = (np.eye(n, n + 1, k=1) - np.eye(n, n + 1)) / np.array(link_lengths_m)[:, None]
    hinges = np.diff(links, axis=0)
    covariance = hinges @ hinges.T
    std = np.sqrt(np.diag(covariance))
    return np.asarray(covariance / np.outer(std, std))


def estimate_noise(data: StageData, adjusted: Adjustment, errors: Errors) -> tuple[Errors, float]:
    """Most probable errors given the stages, with curve and unknowns integrated out (REML), and their log-likelihood including the
    prior.
    """
    lengths, measured = adjusted.balance.rig.leg.link_lengths_m, data.measured
    groups = adjusted.groups
    # The conditions stay linearised at the solution, so that each trial costs only linear algebra.
    parts = linearise_groups(adjusted.balance, groups, measured, errors.covariance(data, lengths), adjusted.point)
    moved = measured - adjusted.point.z
    names = [name for name, there in _learnable(data).items() if there]

    def cost(logs: Floats) -> float:
        trial = errors.scaled_by_logs(dict(zip(names, logs, strict=True)))
        rows = stack_rows(adjusted.balance, rewhiten_groups(parts, groups, moved, trial.covariance(data, lengths)), adjusted.point.p)
        return trial.misfit() - rows.log_likelihood()

    first = np.concatenate([np.zeros((1, len(names))), np.diag([FIRST_LOG_STEP[name] for name in names])])
    # At most three unknowns: a simplex search needs no derivatives.
    found = minimize(
        cost, first[0], method="Nelder-Mead", options={"xatol": SEARCH_TOLERANCE, "fatol": SEARCH_TOLERANCE, "initial_simplex": first}
    )
    return errors.scaled_by_logs(dict(zip(names, found.x, strict=True))), -float(found.fun)


def _learnable(data: StageData) -> dict[str, bool]:
    unstated = data.unstated & data.seen
    return {"hinge": bool(unstated.any()), "stated": bool((data.seen & ~unstated).any()), "force": True}
