"""Gears that yield: what an encoder on the motor's side reads beyond the position of its joint.

    q_read = q + c tau + (b / 2) tanh(tau / tau_b)

`tau` is the torque that the gear transmits: that of the actuator less what accelerates the rotor, which is the joint's `armature`. Friction
acts on the joint's side. The compliance `c` and the play `b` are small beside the travel. The law is quasi-static: it leaves out the
rotor's motion against the joint, which is a share of about (f / f_r)^2 of the deflection at the frequency f, with the rotor's resonance
f_r = 1 / (2 pi sqrt(I c)). A real gear crosses its play in about (6 b I / tau')^(1/3), where tau' is the rate of the torque.

References
----------
Spong, Modeling and control of elastic joint robots, J. Dyn. Sys. Meas. Control 109 (1987) 310.
Nordin and Gutman, Controlling mechanical systems with backlash, a survey, Automatica 38 (2002) 1633.
"""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from rfca_rig.mechanism.plant import Plant

Floats = NDArray[np.float64]

# To either side of a start over which its state is smoothed, and the degree of the polynomial: as the diagnosis estimates recorded states.
SMOOTHED_S, DEGREE = 0.06, 5
PARTS = 12  # of that time in which commands count by their means; with 24 a deflection at a start changes by less than 2 %


def deflect(plant: Plant, torque: Floats) -> Floats:
    """How far the motors (k, n) are ahead of their joints that take these torques."""
    play, taken_up_by = plant.gear_play
    return np.asarray(plant.gear_compliance * torque + 0.5 * play * np.tanh(torque / taken_up_by))


def add_deflection(plant: Plant, by_actuators: Floats, path_q: Floats, path_w: Floats) -> None:
    """Turns positions and speeds of the joints (k + 1, n), before each step and after the last, into those of the motors.

    `by_actuators` (k, n) are the actuators' torques in the steps.
    """
    h = plant.step_s
    within = deflect(plant, by_actuators - plant.model.dof_armature * np.diff(path_w, axis=0) / h)
    path_q[0] += within[0]
    path_q[1:-1] += 0.5 * (within[1:] + within[:-1])
    path_q[-1] += within[-1]
    if len(within) > 1:
        rate = np.diff(within, axis=0) / h
        path_w += np.vstack([rate[:1], rate, rate[-1:]])


def deflection_at_start(plant: Plant, data: Any, commands: Floats) -> tuple[Floats, Floats]:
    """How far the motors are ahead at the start and how fast that grows, (n,) each, smoothed as the start's state is.

    Parameters
    ----------
    plant
        What moves.
    data
        MuJoCo's data, at the start as it was read.
    commands
        (PARTS, u) means over equal parts of the time from SMOOTHED_S before to SMOOTHED_S after the start.
    """
    import mujoco  # noqa: PLC0415  (optional)

    position, speed, acceleration = data.qpos.copy(), data.qvel.copy(), data.qacc.copy()
    times = ((np.arange(PARTS) + 0.5) / PARTS * 2.0 - 1.0) * SMOOTHED_S
    torque = np.empty((PARTS, len(position)))
    for part, t in enumerate(times):
        data.qpos[:] = position + speed * t + 0.5 * acceleration * t**2
        data.qvel[:], data.ctrl[:] = speed + acceleration * t, commands[part]
        mujoco.mj_forward(plant.model, data)
        torque[part] = data.qfrc_actuator - plant.model.dof_armature * data.qacc
    polynomial = np.polynomial.polynomial.polyfit(times / SMOOTHED_S, deflect(plant, torque), DEGREE)
    data.qpos[:], data.qvel[:] = position, speed
    return polynomial[0], polynomial[1] / SMOOTHED_S
