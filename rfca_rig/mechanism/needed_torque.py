"""Torques that the recorded motion of a plant needs beyond those of its actuators.

Inverse dynamics take the recorded states as they are, so that no motion is simulated: fifty seconds
of a seven-axis arm take 30 ms, a tenth of a simulation. It is a view of the torques only: what acts
on readings, and gears that yield, are not in it.
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from rfca_rig.mechanism.plant import Plant
from rfca_rig.mechanism.rollout import CommandTrace, average_steps, limit_by_speed

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class RecordedStates:
    """Recorded states in the middle of k steps of equal length.

    Parameters
    ----------
    step_s, since_s
        The length of a step, and when the first begins after the beginning of the recording.
    position, speed, acceleration
        (k, n) of the joints, as read.
    speed_std
        (n,) how well the speed is known: within it, friction has no direction.
    trace
        The commands, in the time from the first step's beginning on.
    """

    step_s: float
    since_s: float
    position: Floats
    speed: Floats
    acceleration: Floats
    speed_std: Floats
    trace: CommandTrace


def compute_missing_torque(plant: Plant, states: RecordedStates) -> tuple[Floats, Floats]:
    """What the joints need for the motion beyond the torques of the actuators.

    Parameters
    ----------
    plant
        The mechanism. Its model's dry friction is set to zero.
    states
        The motion.

    Returns
    -------
    (k, n), (k, n)
        The torques that are missing, with the sign of friction against the speed, and those of the
        actuators.
    """
    import mujoco  # noqa: PLC0415  (optional)

    model = plant.model
    # As a constraint of MuJoCo it would be a part of the solver's answer, not of the motion.
    model.dof_frictionloss[:] = 0.0
    position = states.position - plant.zero_offset
    commands = average_steps(
        replace(plant, step_s=states.step_s), states.trace, len(position), states.since_s
    )
    commands = limit_by_speed(plant, commands, states.speed)
    needed = np.empty_like(position)
    supplied = np.empty_like(position)
    with plant.mechanism.borrow_data(model) as data:
        for k in range(len(position)):
            data.qpos[:] = position[k]
            data.qvel[:] = states.speed[k]
            data.qacc[:] = states.acceleration[k]
            data.ctrl[:] = commands[k]
            mujoco.mj_inverse(model, data)
            needed[k] = data.qfrc_inverse
            mujoco.mj_fwdActuation(model, data)
            supplied[k] = data.qfrc_actuator
    needed += _resist(plant, states, position, supplied)
    if states.trace.is_powered:
        needed -= plant.torque_offset
    return needed - supplied, supplied


def _resist(plant: Plant, states: RecordedStates, position: Floats, supplied: Floats) -> Floats:
    """Torques (k, n) against the motion by the laws that MuJoCo's model does not have."""
    speed = states.speed
    towards = np.tanh(speed / np.maximum(states.speed_std, 1e-300))
    dry, rise, falls = plant.stribeck
    size = plant.friction + dry * (1.0 + rise * np.exp(-np.abs(speed) / falls))
    against = (size + plant.load_loss * np.abs(supplied)) * towards
    against += _bend_bristles(plant, states)
    for law in plant.laws:
        joint = law.joint
        argument = speed[:, joint] if law.by_speed else position[:, joint]
        rate = states.acceleration[:, joint] if law.by_speed else speed[:, joint]
        against[:, joint] += np.interp(argument, law.knots, law.values)
        branch = np.interp(argument, law.knots, law.branches)
        against[:, joint] += branch * np.tanh(rate / law.turning)
    return np.asarray(against)


def _bend_bristles(plant: Plant, states: RecordedStates) -> Floats:
    """Dahl's friction (k, n) along the motion, from a bristle at rest."""
    torque, travel = plant.hysteresis
    bent = np.zeros_like(states.speed)
    if not torque.any():
        return bent
    bristle = np.zeros(len(torque))
    for k, speed in enumerate(states.speed):
        # Exact for a constant speed during the step, as in the simulation.
        slip = states.step_s * speed / travel
        towards = np.where(slip > 0.0, 1.0, -1.0)
        after = towards + (bristle - towards) * np.exp(-np.abs(slip))
        bent[k] = torque * 0.5 * (bristle + after)
        bristle = after
    return bent
