"""`fit_mechanism`: nominal values of a mechanism, and effects that the user names, fitted to its
recordings.

`compare_mechanism`: recordings of a mechanism beside its nominal and its fitted model, for the
report.
"""

from collections.abc import Collection, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rfca_rig.analysis.fitting.space import Prior
from rfca_rig.campaign.experiment import Experiment
from rfca_rig.diagnosis.inference.model_selection import Progress, search_models
from rfca_rig.diagnosis.inference.parameterization import Parameterization
from rfca_rig.diagnosis.mechanisms.check import can_balance, estimate_states, refuse_misread_columns
from rfca_rig.diagnosis.mechanisms.nuisances import MechanismInput
from rfca_rig.diagnosis.mechanisms.problem import MechanismProblem, make_problem
from rfca_rig.diagnosis.window_fit import WindowFit, fit_effects, summarize
from rfca_rig.errors import BadInput
from rfca_rig.executors.cores import single_threaded_blas
from rfca_rig.mechanism.inverse_dynamics import balance_torques
from rfca_rig.mechanism.plant import Plant
from rfca_rig.model.effect import Effect
from rfca_rig.suggestions import suggestion

MECHANISM_FIT = "rfca-mechanism-fit/1"

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class MechanismFit:
    """The fit, and the mechanism with the fitted values and effects."""

    fit: WindowFit
    plant: Plant


@single_threaded_blas()
def fit_mechanism(
    experiment: Experiment,
    progress: Progress,
    names: Collection[str] = (),
    effects: Sequence[str] = (),
    as_is: bool = False,
) -> MechanismFit:
    """The nominal values of [known_to] and the sizes of effects fitted to all recordings, each with
    its prior.

    Parameters
    ----------
    experiment
        The recordings and the model file.
    progress
        Called with what is being done and the share that is done.
    names
        What to fit, for example "link1.mass_relative", or "mass_relative" for that of all bodies;
        all that [known_to] lists if empty.
    effects
        Ids of the effects that are in the model, of `list_effects`.
    as_is
        Take columns that probably have another sign or unit than stated, too.

    Raises
    ------
    BadInput
        Where nothing is to be fitted, a name is unknown, a column is probably misread, or
        recordings and model do not fit together.
    SimulationFailed
        Where the nominal model cannot be simulated.
    """
    mechanism = experiment.load_model()
    if not as_is:
        refuse_misread_columns(experiment, mechanism)
    problem = make_problem(experiment, mechanism)
    problem.check_effects("--effects", effects)
    space = _select(problem.space, names)
    if not (space.parameters or effects):
        raise BadInput(
            f"{experiment.path}: nothing to fit: [known_to] lists no value that these "
            "recordings depend on; name --effects"
        )
    # An effect that is named twice is added once.
    return fit_problem(
        problem,
        space,
        [problem.simulator.effects[name] for name in dict.fromkeys(effects)],
        progress,
    )


def fit_problem(
    problem: MechanismProblem,
    space: Prior[MechanismInput],
    effects: Sequence[Effect],
    progress: Progress,
) -> MechanismFit:
    """Fit of a prepared problem; without parameters and effects it is the nominal model itself.

    Parameters
    ----------
    problem
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
        problem.dataset,
        Parameterization(space),
        [],
        lambda _, share: progress("fitting nominal values", scale * share),
    )
    fitted = fit_effects(search, effects, progress)
    plant = problem.simulator.plant(
        fitted.fitted.coordinates.supposed(fitted.marginal.posterior.mean)
    )
    return MechanismFit(summarize(search, fitted), plant)


def _select(space: Prior[MechanismInput], names: Collection[str]) -> Prior[MechanismInput]:
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
    problem = make_problem(experiment, mechanism)
    fit = fit_problem(problem, problem.space, (), progress).fit
    mechanism = problem.simulator.mechanism
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
