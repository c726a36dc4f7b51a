"""A shaft speed that varies with the shaft angle."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from rfca_rig.model.effect import Effect, Parameter, Values
from rfca_rig.model.motion import ShaftMotion
from rfca_rig.model.setup import Setup

Floats = NDArray[np.float64]

# Spacing of the pieces of the motion: at 60 cycles per turn and 3.3 rad/s a cycle takes 32 ms.
STEP_S = 5e-4


def apply(setup: Setup, values: Values) -> Setup:
    phase_rad = 2.0 * np.pi * values["phase_cycles"]
    return replace(setup, motion=add_ripple(setup.motion, values["amplitude_relative"], values["cycles_per_turn"], phase_rad))


def add_ripple(motion: ShaftMotion, amplitude: float, cycles: float, phase_rad: float = 0.0) -> ShaftMotion:
    """The motion that follows from the law, in closed form.

    With psi = n (theta - theta_0) + phase, d psi / d theta_c = n (1 + a cos psi). So the angle is a function of the commanded one
    alone: tan(psi / 2) = r tan x, x = sqrt(1 - a^2) n (theta_c - theta_0) / 2 + x_0.
    """
    t = _times(motion)
    start = float(motion.angle_rad(np.zeros(1))[0])
    r = np.sqrt((1.0 + amplitude) / (1.0 - amplitude))
    x = np.sqrt(1.0 - amplitude * amplitude) * cycles * (motion.angle_rad(t) - start) / 2.0 + _scale_tangent(0.5 * phase_rad, 1.0 / r)
    half = _scale_tangent(x, r)
    angle = start + (2.0 * half - phase_rad) / cycles
    return _through(t, angle, _speed(motion, t) * (1.0 + amplitude * np.cos(2.0 * half)), motion)


def _scale_tangent(x: Floats | float, r: float) -> Floats:
    """The angle whose tangent is r tan x, on the branch of x."""
    # As a difference to x, which is always within a quarter turn, the arctangent needs no count of branches.
    return np.asarray(x + np.arctan((r - 1.0) * np.sin(x) * np.cos(x) / (np.cos(x) ** 2 + r * np.sin(x) ** 2)))


def _times(motion: ShaftMotion) -> Floats:
    """Times from zero to the end, with every break of the motion among them."""
    breaks = np.unique(np.maximum(motion.breaks_s, 0.0))
    pieces = (np.linspace(t0, t1, int(np.ceil((t1 - t0) / STEP_S)) + 1)[:-1] for t0, t1 in pairwise(breaks))
    return np.concatenate([*pieces, breaks[-1:]])


def _speed(motion: ShaftMotion, t: Floats) -> Floats:
    i = np.clip(np.searchsorted(motion.breaks_s, t) - 1, 0, len(motion.coefficients) - 1)
    x, c = t - motion.breaks_s[i], motion.coefficients[i].T
    return np.asarray(c[1] + x * (2.0 * c[2] + x * 3.0 * c[3]))


def _through(t: Floats, angle: Floats, speed: Floats, motion: ShaftMotion) -> ShaftMotion:
    # Cubic Hermite pieces through angles and speeds.
    step = np.diff(t)
    rise = np.diff(angle) / step
    square = (3.0 * rise - 2.0 * speed[:-1] - speed[1:]) / step
    cube = (speed[:-1] + speed[1:] - 2.0 * rise) / step**2
    return ShaftMotion(t, np.column_stack([angle[:-1], speed[:-1], square, cube]), motion.landings_s)


EFFECT = Effect(
    id="motor_speed_ripple",
    where="drive",
    left_out="shaft speed that varies with shaft angle",
    law="w = w_c (1 + a cos(n (theta - theta_0) + phase))",
    source="torque ripple of gear and motor",
    parameters=(
        Parameter("amplitude_relative", 0.005, 0.3, below=1.0, starts=(0.05,)),
        # A stroke is half a turn: it distinguishes numbers of cycles that differ by two.
        Parameter("cycles_per_turn", 1.0, 60.0, may_be_zero=False, starts=tuple(1.5 * n for n in range(1, 40))),
    ),
    apply=apply,
    # Periodic, so a fit may go beyond half a cycle in either direction; four starts make one of them near.
    # At 5 % and 10 cycles, fz over a stroke (215 mm, 2.433 rad/s) changes by 0.54 N rms at -0.25, 1.34 N at 0.25, 1.84 N at 0.5
    shape=(Parameter("phase_cycles", -0.5, 0.5, starts=(-0.25, 0.0, 0.25, 0.5)),),
)
