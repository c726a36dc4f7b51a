"""Inverse dynamics: torque balance of recorded states, and the commands for a given motion.

References
----------
Featherstone, Rigid Body Dynamics Algorithms (2008), chapter 5.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rfca_rig.mechanism.load import Mechanism
from rfca_rig.mechanism.plant import Plant

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class States:
    """Recorded states: `position`, `speed` and `acceleration` (k, n) of the joints, and
    `command` (k, u) of the actuators.
    """

    position: Floats
    speed: Floats
    acceleration: Floats
    command: Floats


@dataclass(frozen=True)
class TorqueBalance:
    """Torques in the joints, or forces in slides, that a model computes for recorded states.

    Parameters
    ----------
    inertial
        (k, n) torques that accelerate the joints.
    other
        (k, n) torques that balance weight, gyroscopic torques, springs, dampers, friction and
        contacts; less those of the actuators at a command of 0.
    by_actuator
        (k, u, n) torque of each command.
    """

    inertial: Floats
    other: Floats
    by_actuator: Floats

    @property
    def remainder(self) -> Floats:
        """(k, n) torques in the motion that the model lacks, with the sign of friction against
        the speed; zero for a perfect model.
        """
        return np.asarray(self.inertial + self.other - self.by_actuator.sum(axis=1))

    @property
    def imbalance(self) -> Floats:
        """(n,) rms of the remainder over that of all parts together: 0 for a perfect model, 1
        where the parts are uncorrelated.
        """
        parts = np.mean(
            self.inertial**2 + self.other**2 + self.by_actuator.sum(axis=1) ** 2, axis=0
        )
        return np.asarray(np.sqrt(np.mean(self.remainder**2, axis=0) / np.maximum(parts, 1e-300)))

    def gain(self, actuator: int) -> tuple[float, float]:
        """Best factor on the command of an actuator, by least squares, and the correlation of its
        torque with the required one.

        NaN where the command is 0.
        """
        torque = self.by_actuator[:, actuator]
        needed = self.remainder + torque
        acts = torque.any(axis=0)
        product = float(np.sum(needed[:, acts] * torque[:, acts]))
        own_square = float(np.sum(torque[:, acts] ** 2))
        needed_square = float(np.sum(needed[:, acts] ** 2))
        if own_square == 0.0 or needed_square == 0.0:
            return np.nan, np.nan
        return product / own_square, product / float(np.sqrt(own_square * needed_square))


def balance_torques(mechanism: Mechanism, states: States) -> TorqueBalance:
    """Computes the torques of the nominal model in recorded states.

    Parameters
    ----------
    mechanism
        The mechanism.
    states
        The states, in SI units.
    """
    import mujoco  # noqa: PLC0415  (optional)

    model = mechanism.model
    data = mujoco.MjData(mechanism.model)
    shape = states.position.shape
    inertial = np.empty(shape)
    other = np.empty(shape)
    by_actuator = np.empty((shape[0], model.nu, shape[1]))
    for k in range(shape[0]):
        data.qpos[:] = states.position[k]
        data.qvel[:] = states.speed[k]
        data.qacc[:] = 0.0
        data.ctrl[:] = 0.0
        # Without acceleration the inverse dynamics give all torques but the inertial ones; the
        # difference is the inertial part.
        mujoco.mj_inverse(model, data)
        still = data.qfrc_inverse.copy()
        data.qacc[:] = states.acceleration[k]
        mujoco.mj_inverse(model, data)
        inertial[k] = data.qfrc_inverse - still
        mujoco.mj_fwdActuation(model, data)
        # A position servo has a torque at a command of 0, too.
        idle = data.qfrc_actuator.copy()
        other[k] = still - idle
        for actuator in range(model.nu):
            data.ctrl[:] = 0.0
            data.ctrl[actuator] = states.command[k, actuator]
            mujoco.mj_fwdActuation(model, data)
            by_actuator[k, actuator] = data.qfrc_actuator - idle
    return TorqueBalance(inertial, other, by_actuator)


def torque_motors(mechanism: Mechanism) -> list[int]:
    """Indices of the actuators that act on a joint with a torque proportional to their command."""
    import mujoco  # noqa: PLC0415  (optional)

    model = mechanism.model
    plain = (model.actuator_gaintype == mujoco.mjtGain.mjGAIN_FIXED) & (
        model.actuator_biastype == mujoco.mjtBias.mjBIAS_NONE
    )
    plain &= (model.actuator_trntype == mujoco.mjtTrn.mjTRN_JOINT) & (
        model.actuator_dyntype == mujoco.mjtDyn.mjDYN_NONE
    )
    return [int(actuator) for actuator in np.flatnonzero(plain)]


def has_torque_motors(mechanism: Mechanism) -> bool:
    """Whether every joint has one actuator of its own, whose torque is proportional to its
    command.
    """
    model = mechanism.model
    return len(torque_motors(mechanism)) == model.nu and sorted(model.actuator_trnid[:, 0]) == list(
        range(model.nv)
    )


def compute_feed_forward(
    plant: Plant, position: Floats, speed: Floats, acceleration: Floats
) -> Floats:
    """Commands (k, u) for a motion of a mechanism that `has_torque_motors`.

    Parameters
    ----------
    plant
        The mechanism. Friction that depends on speed counts with its value at high speed.
    position, speed, acceleration
        (k, n) of the joints.
    """
    import mujoco  # noqa: PLC0415  (optional)

    model = plant.model
    data = mujoco.MjData(plant.model)
    joints = model.actuator_trnid[:, 0]
    per_command = model.actuator_gear[:, 0] * model.actuator_gainprm[:, 0] * plant.command_gain
    dry = plant.friction + plant.stribeck[0] + plant.hysteresis[0]
    commands = np.empty((len(position), model.nu))
    for k in range(len(position)):
        data.qpos[:] = position[k] - plant.zero_offset
        data.qvel[:] = speed[k]
        data.qacc[:] = acceleration[k]
        mujoco.mj_inverse(model, data)
        torque = data.qfrc_inverse + dry * np.sign(speed[k]) - plant.torque_offset
        # Friction that grows with the load takes its share of the torque without friction.
        torque = torque + plant.load_loss * np.abs(torque) * np.sign(speed[k])
        commands[k] = torque[joints] / per_command
    return commands
