"""How well angles and forces are known, as far as the stages themselves can tell it."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize

from rfca_rig.analysis.torque_rotation.gauss_helmert import Adjusted, freed, refreed, weighed
from rfca_rig.analysis.torque_rotation.stages import NOT_SEEN_STD_RAD, SHAFT_STD_RAD, StageData

Floats = NDArray[np.float64]

USUAL_HINGE_DEG = 0.15  # of a hinge angle in a photo, to begin from
SPREAD = {"hinge": 2.0, "stated": 0.7, "force": 1.5}  # of the logarithms: how far each may reasonably be off
FIRST_MOVE = {"hinge": 0.4, "stated": 0.3, "force": -0.7}
FINE = 0.02
LEAST_HINGE_RAD, LEAST_FACTOR = 2e-5, 0.02


@dataclass(frozen=True)
class Errors:
    """`hinge_std_rad` stands where no error of an angle was stated; factors multiply what was stated, and what one expects of a mean force.

    `chained`: angles err as those between marks do that neighbouring hinges share; else each on its own.
    """

    hinge_std_rad: float = float(np.radians(USUAL_HINGE_DEG))
    stated_factor: float = 1.0
    force_factor: float = 1.0
    chained: bool = False

    def covariance(self, data: StageData, link_lengths_m: Sequence[float]) -> Floats:
        """(S, h + 4, h + 4) of what was measured at each stage."""
        h = data.hinges
        std = np.where(data.unstated, self.hinge_std_rad, self.stated_factor * data.hinge_std_rad)
        std = np.where(data.seen, std, NOT_SEEN_STD_RAD)
        correlation = of_shared_marks(link_lengths_m) if self.chained else np.eye(h)
        C = np.zeros((len(std), h + 4, h + 4))
        C[:, :h, :h] = std[:, :, None] * correlation * std[:, None, :]
        others = np.concatenate([np.full((len(std), 1), SHAFT_STD_RAD), self.force_factor * data.force_std], axis=1)
        places = np.arange(h, h + 4)
        C[:, places, places] = others**2
        return C

    def moved(self, steps: dict[str, float]) -> "Errors":
        """With logarithms added; a table that was computed has no noise, and the balance needs some."""
        return Errors(
            max(self.hinge_std_rad * float(np.exp(steps.get("hinge", 0.0))), LEAST_HINGE_RAD),
            max(self.stated_factor * float(np.exp(steps.get("stated", 0.0))), LEAST_FACTOR),
            max(self.force_factor * float(np.exp(steps.get("force", 0.0))), LEAST_FACTOR),
            self.chained,
        )

    def misfit(self) -> float:
        """Minus the log of how plausible these are beforehand."""
        usual = float(np.radians(USUAL_HINGE_DEG))
        logs = {"hinge": self.hinge_std_rad / usual, "stated": self.stated_factor, "force": self.force_factor}
        return sum(0.5 * (float(np.log(value)) / SPREAD[name]) ** 2 for name, value in logs.items())


def of_shared_marks(link_lengths_m: Sequence[float]) -> Floats:
    """(h, h) correlation of hinge angles between marks at every hinge and at the tip, all found equally well: neighbours share two."""
    n = len(link_lengths_m)
    links = (np.eye(n, n + 1, k=1) - np.eye(n, n + 1)) / np.array(link_lengths_m)[:, None]
    hinges = np.diff(links, axis=0)
    covariance = hinges @ hinges.T
    std = np.sqrt(np.diag(covariance))
    return np.asarray(covariance / np.outer(std, std))


def learned(data: StageData, adjusted: Adjusted, errors: Errors) -> tuple[Errors, float]:
    """The likeliest errors given the stages, curve and unknowns integrated over (REML), and their log-likelihood, plausibility included."""
    lengths, measured = adjusted.balance.rig.leg.link_lengths_m, data.measured
    groups = adjusted.groups
    parts = freed(adjusted.balance, groups, measured, errors.covariance(data, lengths), adjusted.point)
    moved = measured - adjusted.point.z
    names = [name for name, there in _learnable(data).items() if there]

    def cost(logs: Floats) -> float:
        tried = errors.moved(dict(zip(names, logs, strict=True)))
        rows = weighed(adjusted.balance, refreed(parts, groups, moved, tried.covariance(data, lengths)), adjusted.point.p)
        return tried.misfit() - rows.log_likelihood()

    first = np.concatenate([np.zeros((1, len(names))), np.diag([FIRST_MOVE[name] for name in names])])
    found = minimize(cost, first[0], method="Nelder-Mead", options={"xatol": FINE, "fatol": FINE, "initial_simplex": first})
    return errors.moved(dict(zip(names, found.x, strict=True))), -float(found.fun)


def _learnable(data: StageData) -> dict[str, bool]:
    unstated = data.unstated & data.seen
    return {"hinge": bool(unstated.any()), "stated": bool((data.seen & ~unstated).any()), "force": True}
