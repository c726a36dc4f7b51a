"""Usual torques, speeds and inertias in the recordings of a mechanism, from which the plausible
sizes of effects follow.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rfca_rig.mechanism.load import Mechanism

Floats = NDArray[np.float64]

COMMANDS_LOOKED_AT = 20  # of a window, evenly spread: enough for an rms


@dataclass(frozen=True)
class UsualMotion:
    """Usual magnitudes in the recordings of a mechanism.

    Parameters
    ----------
    torque, speed, travel, inertia
        (n,) of each joint, rms over the recordings: torque of weight, springs and drive, speed,
        travel about the mean, and inertia.
    lowest, highest
        (n,) the range of each joint's position.
    command
        (u,) the largest magnitude of each actuator's command; all zero where nothing was commanded.
    has_speeds
        Whether speeds were recorded.
    sensors
        Rms of each sensor's value that was recorded, by name.
    """

    torque: Floats
    speed: Floats
    travel: Floats
    inertia: Floats
    lowest: Floats
    highest: Floats
    command: Floats
    has_speeds: bool
    sensors: Mapping[str, float]

    @property
    def middle(self) -> Floats:
        """(n,) the middle of each joint's range."""
        return np.asarray(0.5 * (self.highest + self.lowest))

    @property
    def half_range(self) -> Floats:
        """(n,) half of each joint's range."""
        return np.asarray(0.5 * (self.highest - self.lowest))

    @property
    def is_driven(self) -> bool:
        return bool((self.command > 0.0).any())


def measure_usual_motion(
    mechanism: Mechanism,
    position: Floats,
    speed: Floats,
    commands: Sequence[Floats],
    seconds: float,
    has_speeds: bool,
    sensors: Mapping[str, float],
) -> UsualMotion:
    """Computes the usual magnitudes of each joint over the windows of all recordings.

    Parameters
    ----------
    mechanism
        The mechanism.
    position, speed
        (w, n) at the beginning of each window, or at moments of the nominal motion where windows
        start at rest.
    commands
        For each of these, the commands (k, u) of its window.
    seconds
        Length of a window.
    has_speeds
        Whether speeds were recorded.
    sensors
        Rms of each sensor's value that was recorded, by name.
    """
    import mujoco  # noqa: PLC0415  (optional)

    model = mechanism.model
    data = mujoco.MjData(mechanism.model)
    square = np.zeros(model.nv)
    inertia = np.zeros(model.nv)
    column = np.empty(model.nv)
    for at, command in zip(position, commands, strict=True):
        data.qpos[:] = at
        data.qvel[:] = 0.0
        data.ctrl[:] = 0.0
        mujoco.mj_forward(model, data)
        # At zero speed the bias is the weight. Squares add up, as if weight, springs and drive were
        # uncorrelated.
        square += data.qfrc_bias**2 + data.qfrc_spring**2
        # Diagonal of the mass matrix: the inertia that one joint sees with all others still.
        for joint, unit in enumerate(np.eye(model.nv)):
            mujoco.mj_mulM(model, data, column, unit)
            inertia[joint] += column[joint]
        looked_at = command[:: max(1, len(command) // COMMANDS_LOOKED_AT)]
        for now in looked_at:
            data.ctrl[:] = now
            mujoco.mj_forward(model, data)
            square += data.qfrc_actuator**2 / len(looked_at)
    torque = np.sqrt(square / len(position))
    inertia = inertia / len(position)
    usual_speed = np.sqrt(np.mean(speed**2, axis=0))
    travel = np.std(position, axis=0)
    # Without weight, springs and drive, the torque that would stop the motion within a window sets
    # the scale.
    stopping = inertia * usual_speed / seconds
    if not torque.any():
        torque = stopping
    # The weight of a free body acts along one axis, and the air along all of them.
    for frame in mechanism.frames:
        places = [mechanism.joints.index(name) for name in frame.joints]
        torque[places[:3]] = np.linalg.norm(torque[places[:3]])
        torque[places[3:]] = stopping[places[3:]]
    largest = np.max([np.abs(command).max(axis=0, initial=0.0) for command in commands], axis=0)
    torque, usual_speed, travel, inertia = (
        _not_small(v, mechanism) for v in (torque, usual_speed, travel, inertia)
    )
    lowest = position.min(axis=0)
    highest = position.max(axis=0)
    return UsualMotion(
        torque, usual_speed, travel, inertia, lowest, highest, largest, has_speeds, sensors
    )


def _not_small(values: Floats, mechanism: Mechanism) -> Floats:
    """Raises small values to a tenth of the largest one of the same kind; hinges and slides have
    different units.

    Joints that are prescribed set no scale for the others.
    """
    slides = mechanism.is_slide
    moving = np.isin(np.arange(len(values)), mechanism.simulated)
    largest = [float(values[(slides == kind) & moving].max(initial=0.0)) for kind in slides]
    return np.maximum(values, np.maximum(0.1 * np.array(largest), 1e-12))
