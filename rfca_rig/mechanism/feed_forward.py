"""The commands that carry a mechanism along a given motion: inverse dynamics."""

import numpy as np
from numpy.typing import NDArray

from rfca_rig.mechanism.load import Mechanism
from rfca_rig.mechanism.plant import Plant

Floats = NDArray[np.float64]


def has_torque_motors(mechanism: Mechanism) -> bool:
    """Whether every joint has one actuator of its own, whose torque is proportional to its command."""
    import mujoco  # noqa: PLC0415  (optional)

    model = mechanism.model
    on_joints = (model.actuator_trntype == mujoco.mjtTrn.mjTRN_JOINT).all()
    own = sorted(model.actuator_trnid[:, 0]) == list(range(model.nv))
    plain = (model.actuator_gaintype == mujoco.mjtGain.mjGAIN_FIXED).all() and (model.actuator_biastype == mujoco.mjtBias.mjBIAS_NONE).all()
    return bool(on_joints and own and plain and (model.actuator_dyntype == mujoco.mjtDyn.mjDYN_NONE).all())


def compute_feed_forward(plant: Plant, position: Floats, speed: Floats, acceleration: Floats) -> Floats:
    """The commands (k, u) that a motion takes, of a mechanism that `has_torque_motors`.

    Parameters
    ----------
    plant
        What moves. Friction that depends on speed or load counts with its value at high speed.
    position, speed, acceleration
        (k, n) of the joints.

    References
    ----------
    Featherstone, Rigid Body Dynamics Algorithms (2008), chapter 5.
    """
    import mujoco  # noqa: PLC0415  (optional)

    model, data = plant.model, mujoco.MjData(plant.model)
    joints = model.actuator_trnid[:, 0]
    per_command = model.actuator_gear[:, 0] * model.actuator_gainprm[:, 0] * plant.command_gain
    dry = plant.friction + plant.stribeck[0] + plant.hysteresis[0]
    commands = np.empty((len(position), model.nu))
    for k in range(len(position)):
        data.qpos[:], data.qvel[:], data.qacc[:] = position[k] - plant.zero_offset, speed[k], acceleration[k]
        mujoco.mj_inverse(model, data)
        torque = data.qfrc_inverse + dry * np.sign(speed[k]) - plant.torque_offset
        torque = torque + plant.load_loss * np.abs(torque) * np.sign(speed[k])
        commands[k] = torque[joints] / per_command
    return commands
