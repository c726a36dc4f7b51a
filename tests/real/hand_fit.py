"""A least-squares fit of the published law, by hand: the yardstick of the diagnosis on real
recordings.

- Windows, starts and simulator are those of the diagnosis. Only the law is given, and nothing is
  searched for.
- The fit minimises the squared differences of the positions. It moves the law's values and the
  nominal values, as the diagnosis does, but without priors; friction, damping and rotors stay above
  zero.
- Held out is one condition at a time: the law is fitted to all others, and then predicts it. The
  diagnosis does the same, with the same conditions.
"""

from dataclasses import dataclass

import numpy as np
from scipy.optimize import least_squares

from rfca_rig.diagnosis.data import rms
from rfca_rig.diagnosis.mechanisms.nuisances import MechanismInput
from rfca_rig.diagnosis.mechanisms.prepared import PreparedMechanism, prepare_mechanism
from rfca_rig.errors import SimulationFailed
from rfca_rig.mechanism.load import load_mechanism
from rfca_rig.mechanism.nuisances import NUISANCES, find_places

STEP = 1e-3  # of finite differences, in the scale of a parameter
# where parameters that stay above zero begin, in their scale: at zero, dry friction has no slope
BEGINNING = 0.1
DIVERGED = 1e3  # residual of a simulation that diverges, in rad or m
LEAST_SHARE = -0.9  # of masses and inertias
MOST_EVALUATIONS = 60


@dataclass(frozen=True)
class FreeParameter:
    """One value that the fit moves: a key of [known_to] and the place of its object. It is
    counted in units of `scale`.
    """

    name: str
    key: str
    place: int
    scale: float
    least: float


@dataclass(frozen=True)
class HandFit:
    """What a fit found.

    Parameters
    ----------
    values
        By parameter: the value from all conditions, and its standard deviation from the residuals.
    held_out
        By signal: rms of the held-out differences.
    """

    values: dict[str, tuple[float, float]]
    held_out: dict[str, float]


def list_free(problem: PreparedMechanism, keys: list[str]) -> list[FreeParameter]:
    """The parameters of a law that is given by keys of [known_to], of every object that a key
    belongs to.
    """
    mechanism = problem.simulator.mechanism
    usual = problem.usual
    torque = usual.torque
    inertia = usual.inertia
    sizes = {
        "friction": torque,
        "offset": 0.2 * torque,
        "damping": torque / usual.speed,
        "rotor": 0.1 * inertia,
    }
    plain = {
        "_relative": 0.2,
        "centre_of_mass_m": 0.02,
        "zero_offset": 0.01,
        "command_delay_s": 0.004,
    }
    found = []
    for key in keys:
        kind = NUISANCES[key]
        for name, place in find_places(mechanism, kind.objects).items():
            by_name = [value for part, value in plain.items() if part in key]
            if by_name:
                scale = by_name[0]
            else:
                scale = next(float(size[place]) for part, size in sizes.items() if part in key)
            least = -np.inf if kind.nominal is None else -kind.nominal(mechanism, place)
            found.append(
                FreeParameter(
                    f"{name}.{key}",
                    key,
                    place,
                    scale,
                    LEAST_SHARE if key.endswith("_relative") else least,
                )
            )
    return found


class Fit:
    """The law with its free parameters, and the recordings."""

    def __init__(self, problem: PreparedMechanism, free: list[FreeParameter]):
        self.problem = problem
        self.free = free
        self.scales = np.array([one.scale for one in free])
        self.least = np.array([one.least for one in free]) / self.scales
        self.start = np.array([BEGINNING if one.least == 0.0 else 0.0 for one in free])

    def misfits(self, x, conditions):
        """Measured less predicted of each condition, by signal (s, m)."""
        pairs = zip(self.free, x * self.scales, strict=True)
        at = MechanismInput(tuple(((one.key, one.place), float(value)) for one, value in pairs))
        plant = self.problem.simulator.plant(at)
        found = []
        for condition in conditions:
            parts = []
            for window in condition.windows:
                try:
                    parts.append(
                        window.window.measured - self.problem.simulator.predict(plant, window)
                    )
                except SimulationFailed:
                    parts.append(np.full(window.window.measured.shape, DIVERGED))
            found.append(np.concatenate(parts, axis=1))
        return found

    def positions(self, x, conditions):
        """The same of the positions as one vector."""
        joints = len(self.problem.simulator.mechanism.joints)
        return np.concatenate(
            [
                one[self.problem.simulator.columns < joints].ravel()
                for one in self.misfits(x, conditions)
            ]
        )

    def solve(self, conditions, start):
        """The least-squares solution."""

        def differences(x):
            return self.positions(x, conditions)

        def slopes(x):
            here = differences(x)
            return np.column_stack(
                [(differences(x + step) - here) / STEP for step in STEP * np.eye(len(x))]
            )

        limits = (self.least, np.inf)
        return least_squares(
            differences,
            start,
            jac=slopes,
            bounds=limits,
            max_nfev=MOST_EVALUATIONS,
            xtol=1e-4,
            ftol=1e-5,
        )


def fit_by_hand(experiment, keys):
    """The law of these keys of [known_to], fitted to the recordings together with all values that
    [known_to] of the recordings lists.

    Parameters
    ----------
    experiment
        The recordings and the model file.
    keys
        Of the published law.
    """
    problem = prepare_mechanism(experiment, load_mechanism(experiment.model))
    return solve_problem(
        problem,
        list(dict.fromkeys([*keys, *(key for key in experiment.known_to if key in NUISANCES)])),
    )


def solve_problem(problem, keys):
    """The same for windows that are cut already."""
    fit = Fit(problem, list_free(problem, keys))
    conditions = problem.conditions
    whole = fit.solve(conditions, fit.start)
    spread = (
        2.0
        * whole.cost
        / max(1, len(whole.fun) - len(whole.x))
        * np.linalg.pinv(whole.jac.T @ whole.jac)
    )
    stds = np.sqrt(np.diag(spread)) * fit.scales
    apart = []
    for number, out in enumerate(conditions):
        others = [*conditions[:number], *conditions[number + 1 :]]
        apart += fit.misfits(fit.solve(others, whole.x).x, [out])
    by_signal = zip(conditions[0].signals, np.concatenate(apart, axis=1), strict=True)
    return HandFit(
        values={
            one.name: (float(v), float(s))
            for one, v, s in zip(fit.free, whole.x * fit.scales, stds, strict=True)
        },
        held_out={name: rms(row) for name, row in by_signal if "position" in name},
    )
