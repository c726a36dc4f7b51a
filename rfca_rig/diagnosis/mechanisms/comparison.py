"""`compare_mechanism`: recordings of a mechanism beside its nominal and its fitted model, for the report."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rfca_rig.campaign.experiment import Experiment
from rfca_rig.diagnosis.inference.model_selection import Progress
from rfca_rig.diagnosis.mechanisms.check import can_balance, estimate_states
from rfca_rig.diagnosis.mechanisms.fit import fit_problem
from rfca_rig.diagnosis.mechanisms.problem import make_problem
from rfca_rig.diagnosis.window_fit import WindowFit
from rfca_rig.executors.cores import single_threaded_blas
from rfca_rig.mechanism.inverse_dynamics import balance_torques
from rfca_rig.mechanism.load import load_mechanism

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class JointRemainder:
    """Torque or force in one joint in the recorded motion that the nominal model does not explain, all (k,).

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
    """The fit of the values of [known_to], and the torque in each joint that the nominal model lacks."""

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
    mechanism = load_mechanism(experiment.model)
    problem = make_problem(experiment, mechanism)
    fit = fit_problem(problem, problem.space, (), progress).fit
    mechanism = problem.simulator.mechanism
    states = estimate_states(experiment, mechanism)
    remainder = balance_torques(mechanism, states).remainder
    joints = [
        JointRemainder(name, bool(mechanism.is_slide[j]), states.position[:, j], states.speed[:, j], remainder[:, j])
        for j, name in enumerate(mechanism.joints if can_balance(mechanism) else ())
    ]
    return MechanismComparison(fit, tuple(joints))
