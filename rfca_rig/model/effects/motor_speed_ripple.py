"""A shaft speed that varies with the shaft angle."""

from dataclasses import replace

import numpy as np

from rfca_rig.model.effect import Effect, Parameter, Values
from rfca_rig.model.motion import ShaftMotion
from rfca_rig.model.setup import Setup

STEP_S = 5e-4


def apply(setup: Setup, values: Values) -> Setup:
    return replace(setup, motion=rippled(setup.motion, values["amplitude_relative"], values["cycles_per_turn"]))


def rippled(motion: ShaftMotion, amplitude: float, cycles: float) -> ShaftMotion:
    """d theta/dt = w_c(t) (1 + a cos(n (theta - theta_0))), by the classical fourth-order Runge-Kutta method."""
    t = np.arange(0.0, motion.breaks_s[-1] + STEP_S, STEP_S)
    commanded = np.gradient(motion.angle_rad(np.arange(0.0, t[-1] + STEP_S, 0.5 * STEP_S)), 0.5 * STEP_S)
    start = theta = float(motion.angle_rad(np.zeros(1))[0])
    angle, speed = [theta], []
    for k in range(len(t) - 1):
        rates: list[float] = []
        for w, share in ((commanded[2 * k], 0.0), (commanded[2 * k + 1], 0.5), (commanded[2 * k + 1], 0.5), (commanded[2 * k + 2], 1.0)):
            at = theta + share * STEP_S * (rates[-1] if rates else 0.0)
            rates.append(w * (1.0 + amplitude * np.cos(cycles * (at - start))))
        speed.append(rates[0])
        theta += STEP_S / 6.0 * (rates[0] + 2.0 * rates[1] + 2.0 * rates[2] + rates[3])
        angle.append(theta)
    return _through(t, np.array(angle), np.array([*speed, speed[-1]]), motion)


def _through(t: np.ndarray, angle: np.ndarray, speed: np.ndarray, motion: ShaftMotion) -> ShaftMotion:
    rise = np.diff(angle) / STEP_S
    square = (3.0 * rise - 2.0 * speed[:-1] - speed[1:]) / STEP_S
    cube = (speed[:-1] + speed[1:] - 2.0 * rise) / STEP_S**2
    return ShaftMotion(t, np.column_stack([angle[:-1], speed[:-1], square, cube]), motion.landings_s)


EFFECT = Effect(
    id="motor_speed_ripple",
    where="drive",
    left_out="shaft speed that varies with shaft angle",
    law="w = w_c (1 + a cos(n (theta - theta_0)))",
    source="torque ripple of gear and motor",
    parameters=(
        Parameter("amplitude_relative", 0.005, 0.3),
        Parameter("cycles_per_turn", 1.0, 60.0),
    ),
    apply=apply,
)
