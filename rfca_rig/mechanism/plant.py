"""One version of a mechanism: MuJoCo's model, and beside it what such a model cannot hold."""

import copy
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rfca_rig.mechanism.load import Mechanism

Floats = NDArray[np.float64]


@dataclass(eq=False)
class Plant:
    """A copy of a mechanism's model that nuisance parameters and effects may change.

    Parameters
    ----------
    mechanism
        The mechanism as the file has it.
    model
        MuJoCo's model of this version.
    step_s
        Length of the integrator's step.
    friction
        (n,) dry friction of each joint [N m or N]; it stands in for the model's `frictionloss`.
    stribeck
        (3, n) dry friction that falls with speed: its value at high speed, its rise at rest as a share, the speed it falls with.
    load_loss
        (n,) share of the actuators' torque that each joint loses by friction.
    torque_offset, zero_offset
        (n,) steady torque in each joint, and what each position is read too large.
    command_gain, command_limit
        (u,) factor on the recorded commands, and their largest magnitude.
    command_delay_s, command_lag_s
        How much later than recorded they act: dead time, and time constant of a low-pass.
    speed_lag_s
        Time constant of a low-pass over the readings of speed.
    """

    mechanism: Mechanism
    model: Any
    step_s: float
    friction: Floats
    stribeck: Floats
    load_loss: Floats
    torque_offset: Floats
    zero_offset: Floats
    command_gain: Floats
    command_limit: Floats
    command_delay_s: float = 0.0
    command_lag_s: float = 0.0
    speed_lag_s: float = 0.0


def make_plant(mechanism: Mechanism, step_s: float) -> Plant:
    """The mechanism as its file has it."""
    import mujoco  # noqa: PLC0415  (optional)

    model = copy.copy(mechanism.model)
    model.opt.timestep = step_s
    model.opt.integrator = mujoco.mjtIntegrator.mjINT_RK4
    model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_AUTORESET
    zeros = np.zeros(model.nv)
    return Plant(
        mechanism=mechanism,
        model=model,
        step_s=step_s,
        friction=model.dof_frictionloss.copy(),
        stribeck=np.vstack([zeros, zeros, zeros + 1.0]),
        load_loss=zeros.copy(),
        torque_offset=zeros.copy(),
        zero_offset=zeros.copy(),
        command_gain=np.ones(model.nu),
        command_limit=np.full(model.nu, np.inf),
    )


def update_constants(plant: Plant) -> None:
    """Has MuJoCo derive what it keeps of masses and joints, after they were changed."""
    import mujoco  # noqa: PLC0415  (optional)

    mujoco.mj_setConst(plant.model, mujoco.MjData(plant.model))


Change = Callable[[Plant, int, float], None]
"""Adds a value to a plant, at the place of a joint, a body or an actuator."""


def add_to(field: str, least: float = -np.inf) -> Change:
    """Adds to an array of MuJoCo's model, to the first column of one with several; the sum is not below `least`."""

    def change(plant: Plant, place: int, by: float) -> None:
        array = getattr(plant.model, field)
        at = (place, 0) if array.ndim > 1 else place
        array[at] = max(least, array[at] + by)

    return change


def add_friction(plant: Plant, joint: int, by: float) -> None:
    """Adds dry friction; the sum is not below zero."""
    plant.friction[joint] = max(0.0, plant.friction[joint] + by)
