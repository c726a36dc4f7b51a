"""Positions, speeds and accelerations of the joints at moments of the recordings, from the recorded positions alone."""

import numpy as np
from numpy.typing import NDArray

from rfca_rig.analysis.swings import SMOOTHING_HALF_WIDTH_S, local_polynomial
from rfca_rig.campaign.experiment import Experiment
from rfca_rig.diagnosis.mechanisms.problem import arrange_commands, match_columns
from rfca_rig.mechanism.inverse_dynamics import States
from rfca_rig.mechanism.load import Mechanism

Floats = NDArray[np.float64]

MOST_STATES = 400  # of all recordings together: enough for an rms and a picture


def can_balance(mechanism: Mechanism) -> bool:
    """Whether the torques of recorded states balance in the model: every state is known, and no force acts beside MuJoCo's."""
    return not (mechanism.unmeasured or mechanism.prescribed or mechanism.contacts)


def estimate_states(experiment: Experiment, mechanism: Mechanism) -> States:
    """States at moments spread evenly over all recordings, from the recorded positions.

    Parameters
    ----------
    experiment
        The recordings.
    mechanism
        The nominal mechanism with n joints.

    Returns
    -------
    States
        (k, n) positions, speeds and accelerations; none within a gap, and none at all unless the mechanism `can_balance`.

    Raises
    ------
    BadInput
        As `match_columns`.
    """
    match = match_columns(experiment, mechanism)
    total_s = sum(float(run.t_s[-1] - run.t_s[0]) for run in experiment.runs)
    apart_s = max(experiment.bin_s, total_s / MOST_STATES)
    derivatives: list[list[Floats]] = []
    commands: list[list[Floats]] = []
    for run in experiment.runs if can_balance(mechanism) else ():
        recorded, commanded = run.signals[:, match.positions], arrange_commands(run, mechanism, match)
        for at_s in np.arange(run.t_s[0] + SMOOTHING_HALF_WIDTH_S, run.t_s[-1] - SMOOTHING_HALF_WIDTH_S, apart_s):
            # A local polynomial over a gap would invent the motion there.
            near_s = run.t_s[np.abs(run.t_s - at_s) <= SMOOTHING_HALF_WIDTH_S]
            if near_s.size > 1 and np.diff(near_s).max() <= experiment.bin_s:
                local = local_polynomial(run.t_s, recorded, float(at_s))
                derivatives.append([local.derivative(order) for order in range(3)])
                commands.append([np.interp(at_s, run.t_s, column) for column in commanded.T])
    shape = (len(derivatives), 3, len(mechanism.joints))
    position, speed, acceleration = np.moveaxis(np.array(derivatives).reshape(shape), 1, 0)
    return States(position, speed, acceleration, np.array(commands).reshape(len(commands), len(mechanism.actuators)))
