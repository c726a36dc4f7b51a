"""MAP fit of nominal values of a mechanism, and of effects that the user names, to its recordings.

`compare_mechanism`: recordings of a mechanism beside its nominal and its fitted model, for the
report.
"""

from collections.abc import Collection, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rfca_rig.analysis.fitting.space import Prior
from rfca_rig.campaign.experiment import Experiment
from rfca_rig.campaign.pendulum import is_pendulum, write_fitted_pendulum
from rfca_rig.diagnosis.inference.model_selection import Progress, search_models
from rfca_rig.diagnosis.inference.parameterization import Parameterization
from rfca_rig.diagnosis.mechanisms.check import can_balance, estimate_states
from rfca_rig.diagnosis.mechanisms.nuisances import MechanismInput
from rfca_rig.diagnosis.mechanisms.prepared import PreparedMechanism, prepare_mechanism
from rfca_rig.diagnosis.problem import Row
from rfca_rig.diagnosis.window_fit import WindowFit, fit_effects, summarize
from rfca_rig.errors import BadInput
from rfca_rig.executors.cores import single_threaded_blas
from rfca_rig.mechanism.inverse_dynamics import balance_torques
from rfca_rig.mechanism.model_files import write_amended_model
from rfca_rig.mechanism.plant import Plant
from rfca_rig.model.effect import Effect
from rfca_rig.suggestions import suggestion

MECHANISM_FIT = "rfca-mechanism-fit/1"

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class MechanismFit:
    """The fit, and the mechanism with the fitted values and effects.

    Parameters
    ----------
    fit
        The fitted values and the errors of the signals.
    plant
        The mechanism with them.
    experiment
        The recordings.
    """

    fit: WindowFit
    plant: Plant
    experiment: Experiment

    def plain(self) -> dict[str, Any]:
        """Everything but the signals as plain data, for JSON."""
        return self.fit.plain(MECHANISM_FIT)

    def lines(self) -> list[str]:
        """The values and errors as lines for a terminal."""
        return self.fit.lines()

    def rows(self) -> tuple[Row, ...]:
        """A row per value: shift from nominal, or size of an effect, and standard deviation."""
        shifts: tuple[Row, ...] = tuple(
            {"name": s.name, "shift": s.value, "std": s.std, "prior_std": s.prior_std}
            for s in self.fit.shifts
        )
        sizes: tuple[Row, ...] = tuple(
            {"name": f"{s.effect}.{s.name}", "shift": s.value, "std": s.std, "prior_std": None}
            for s in self.fit.sizes
        )
        return shifts + sizes

    def write_model(self, path: Path) -> Sequence[str]:
        """Write MJCF with the fitted values and effects; the links of a pendulum for a file that
        ends with .toml.

        Raises BadInput where no pendulum has the fitted values, RigError where the disk refuses.
        """
        if is_pendulum(self.experiment) and path.suffix == ".toml":
            folder = self.experiment.path.parent
            head = f"Fitted to {folder} (IMPORT): {self.experiment.title}"
            shifts = {shift.name: (shift.value, shift.std) for shift in self.fit.shifts}
            write_fitted_pendulum(path, folder, shifts, [head, *self.fit.lines()])
            return ()
        beyond = write_amended_model(self.plant, path)
        if beyond:
            return (f"{path}: MJCF does not hold {', '.join(beyond)}; see the fitted values",)
        return ()


def fit_prepared(
    prepared: PreparedMechanism,
    space: Prior[MechanismInput],
    effects: Sequence[Effect],
    progress: Progress,
) -> MechanismFit:
    """Fit of prepared recordings; without parameters and effects it is the nominal model itself.

    Parameters
    ----------
    prepared
        The recordings in windows.
    space
        Those of the nuisance parameters that are fitted.
    effects
        The effects that are in the model.
    progress
        Called with the current step and the share that is done.
    """
    scale = 0.5 if effects else 0.9
    search = search_models(
        prepared.dataset,
        Parameterization(space),
        [],
        lambda _, share: progress("fitting nominal values", scale * share),
    )
    fitted = fit_effects(search, effects, progress)
    plant = prepared.simulator.plant(
        fitted.fitted.coordinates.supposed(fitted.marginal.posterior.mean)
    )
    return MechanismFit(summarize(search, fitted), plant, prepared.experiment)


def select_nuisances(space: Prior[MechanismInput], names: Collection[str]) -> Prior[MechanismInput]:
    """The parameters of these names, or of these keys of [known_to]; all if no name is given."""
    # A key alone stands for this value of all bodies, joints or actuators.
    keys = [name.rpartition(".")[2] for name in space.names]
    for name in names:
        if name not in (*space.names, *keys):
            raise BadInput(
                f"--parameters: {name!r} is no value of [known_to]; "
                f"{suggestion(name, dict.fromkeys((*keys, *space.names)))}"
            )
    chosen = [
        index
        for index, full in enumerate(space.names)
        if not names or full in names or keys[index] in names
    ]
    parameters = tuple(space.parameters[index] for index in chosen)
    return Prior(parameters, space.centre, space.std[chosen], np.ones(len(chosen), dtype=bool))


@dataclass(frozen=True)
class JointRemainder:
    """Torque or force in one joint in the recorded motion that the nominal model does not explain,
    all (k,).

    Parameters
    ----------
    joint
        Its name.
    is_slide
        Whether positions are in m and the remainder in N, instead of rad and N m.
    position, speed, remainder
        Of each state.
    """

    joint: str
    is_slide: bool
    position: Floats
    speed: Floats
    remainder: Floats


@dataclass(frozen=True)
class MechanismComparison:
    """The fit of the values of [known_to], and the torque in each joint that the nominal model
    lacks.
    """

    fit: WindowFit
    joints: tuple[JointRemainder, ...]


@single_threaded_blas()
def compare_mechanism(experiment: Experiment, progress: Progress) -> MechanismComparison:
    """Recordings beside their model.

    Parameters
    ----------
    experiment
        The recordings and the model file.
    progress
        Called with what is being done and the share that is done.

    Raises
    ------
    BadInput
        Where recordings and model do not fit together.
    SimulationFailed
        Where the nominal model cannot be simulated.
    """
    mechanism = experiment.load_model()
    prepared = prepare_mechanism(experiment, mechanism)
    fit = fit_prepared(prepared, prepared.space, (), progress).fit
    mechanism = prepared.simulator.mechanism
    states = estimate_states(experiment, mechanism)
    remainder = balance_torques(mechanism, states).remainder
    joints = [
        JointRemainder(
            name,
            bool(mechanism.is_slide[j]),
            states.position[:, j],
            states.speed[:, j],
            remainder[:, j],
        )
        for j, name in enumerate(mechanism.joints if can_balance(mechanism) else ())
    ]
    return MechanismComparison(fit, tuple(joints))
