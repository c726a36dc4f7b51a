"""Elastic gears and gears with play: the difference between an encoder on the motor's side and the
position of its joint.

    q_read = q + c tau + z,    I z'' = tau within the play, abs(z) <= b / 2

`tau` is the torque that the gear transmits: that of the actuator less the part that accelerates the
rotor, the joint's `armature`. Friction acts on the joint's side. The joint moves as with a rigid
gear; the compliance `c` and the play `b` only change the reading, and must be small beside the
travel.

The elastic part is quasi-static: it neglects the rotor's motion against the joint, a share of about
(f / f_r)^2 of the deflection at the frequency f, with the rotor's resonance f_r = 1 / (2 pi sqrt(I
c)). Play is not quasi-static: a rotor of 0.06 kg m2 takes 80 ms to cross 0.03 rad when a controller
reverses its torque. So its inertia `I` carries it across, and its teeth do not bounce.

References
----------
Spong, Modeling and control of elastic joint robots, J. Dyn. Sys. Meas. Control 109 (1987) 310.
Nordin and Gutman, Controlling mechanical systems with backlash, a survey, Automatica 38 (2002)
1633.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rfca_rig.mechanism.plant import Plant
from rfca_rig.model.kernel.compiled import jit

Floats = NDArray[np.float64]

# Half of the span over which a start is smoothed, and the degree of the polynomial: the diagnosis
# estimates recorded states in this way.
SMOOTHED_S = 0.06
DEGREE = 5
# The span is divided into parts with mean commands: twice as many as the polynomial has
# coefficients.
PARTS = 12
FINER = 5  # steps of a rotor within a part


@dataclass(frozen=True)
class GearStart:
    """Lead of the motors over the joints at a start and its rate, from smoothed readings; both
    for the rotors in their play. All (n,).
    """

    ahead: Floats
    rate: Floats
    lead: Floats
    lead_rate: Floats


@jit
def cross_play(
    torque: Floats,
    play: Floats,
    inertia: Floats,
    h: float,
    lead: Floats,
    rate: Floats,
    leads: Floats,
) -> None:
    """Carries rotors across their play under torques (k, n); `lead` and `rate` (n,) go on,
    `leads` (k, n) are those after each step.
    """
    for k in range(torque.shape[0]):
        for i in range(torque.shape[1]):
            rate[i] += h * torque[k, i] / inertia[i]
            lead[i] += h * rate[i]
            # The tooth meets the flank and stays there: a plastic impact.
            if abs(lead[i]) >= 0.5 * play[i]:
                lead[i] = 0.5 * play[i] if lead[i] > 0.0 else -0.5 * play[i]
                rate[i] = 0.0
            leads[k, i] = lead[i]


def _cross(plant: Plant, torque: Floats, h: float, lead: Floats, rate: Floats) -> Floats:
    play, least = plant.gear_play
    leads = np.empty_like(torque)
    cross_play(torque, play, np.maximum(plant.model.dof_armature, least), h, lead, rate, leads)
    return leads


def add_deflection(
    plant: Plant,
    start: GearStart,
    by_actuators: Floats,
    path_q: Floats,
    path_w: Floats,
    sample_s: float,
) -> None:
    """Converts positions and speeds of the joints (k + 1, n), before each step and after the last,
    to those of the motors, in place.

    `by_actuators` (k, n) are the actuators' torques in the steps. Recorded commands are constant
    over a sample, so speeds are differences over a sample at least.
    """
    h = plant.step_s
    torque = by_actuators - plant.model.dof_armature * np.diff(path_w, axis=0) / h
    bend = plant.gear_compliance * torque
    ahead = np.vstack(
        [start.lead, _cross(plant, torque, h, start.lead.copy(), start.lead_rate.copy())]
    )
    # Odd reflection continues the deflection with its slope at both ends.
    around = np.pad(bend, ((1, 1), (0, 0)), mode="reflect", reflect_type="odd")
    ahead += 0.5 * (around[1:] + around[:-1])
    over = min(max(1, round(0.5 * sample_s / h)), len(bend))
    beyond = np.pad(ahead, ((over, over), (0, 0)), mode="reflect", reflect_type="odd")
    path_q += ahead
    path_w += (beyond[2 * over :] - beyond[: -2 * over]) / (2.0 * over * h)


def estimate_gear_start(plant: Plant, data: Any, commands: Floats) -> GearStart:
    """Estimates the deflection of the gears at the start of a motion.

    Parameters
    ----------
    plant
        The mechanism.
    data
        MuJoCo's data, at the start as it was read.
    commands
        (PARTS, u) means over equal parts of the time from SMOOTHED_S before to SMOOTHED_S after the
        start.
    """
    import mujoco  # noqa: PLC0415  (optional)

    position = data.qpos.copy()
    speed = data.qvel.copy()
    acceleration = data.qacc.copy()
    times = ((np.arange(PARTS) + 0.5) / PARTS * 2.0 - 1.0) * SMOOTHED_S
    torque = np.empty((PARTS, len(position)))
    # The motion near the start is a parabola through its state; only the torque along it is needed.
    for part, t in enumerate(times):
        data.qpos[:] = position + speed * t + 0.5 * acceleration * t**2
        data.qvel[:] = speed + acceleration * t
        data.ctrl[:] = commands[part]
        mujoco.mj_forward(plant.model, data)
        torque[part] = data.qfrc_actuator - plant.model.dof_armature * data.qacc
    data.qpos[:] = position
    data.qvel[:] = speed
    # At the beginning of the span each rotor is assumed at the flank that its torque presses on.
    lead = 0.5 * plant.gear_play[0] * np.sign(torque[0])
    rate = np.zeros(len(position))
    fine = np.repeat(torque, FINER, axis=0)
    h = 2.0 * SMOOTHED_S / PARTS / FINER
    before = _cross(plant, fine[: len(fine) // 2], h, lead, rate)
    lead_at_start = lead.copy()
    rate_at_start = rate.copy()
    leads = np.vstack([before, _cross(plant, fine[len(fine) // 2 :], h, lead, rate)])
    ahead = plant.gear_compliance * torque + leads.reshape(PARTS, FINER, -1).mean(axis=1)
    polynomial = np.polynomial.polynomial.polyfit(times / SMOOTHED_S, ahead, DEGREE)
    return GearStart(polynomial[0], polynomial[1] / SMOOTHED_S, lead_at_start, rate_at_start)
