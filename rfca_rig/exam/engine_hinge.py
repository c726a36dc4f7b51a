"""Torques that resist the turn of a hinge. The laws are independent of each other.

The memories of friction and hysteresis depend on the turned angle only, not on the step.
"""

import numpy as np
from numpy.typing import NDArray

from rfca_rig.exam.compiled import jit_internal

Floats = NDArray[np.float64]

# columns of `hinge` (n, 18), row 0 unused: the shaft has no spring
K0, K2, DAMPING, GAP, PRESET, ASYMMETRY, QUADRATIC, STOP, STOP_STIFFNESS = range(9)
PIN, LOOP, LOOP_ANGLE, ARM, ARM_TIME, PIN_CREEP, DETENT, DETENTS, TENDON = range(9, 18)
# columns of `memory` (n, 3): share of the pin's friction in use, the loop's share, the dashpot's angle
PIN_SHARE, LOOP_SHARE, ARM_ANGLE = range(3)


@jit_internal
def dahl(share: float, moved: float, creep: float) -> float:
    """Share of dry friction in use after a move: Dahl's law with exponent one half, exact for a move in one direction.

    df/dx = sgn (1 - f sgn)^(1/2) / creep. Full friction is reached after a finite distance, 2 creep from none.
    """
    side = 1.0 if moved >= 0.0 else -1.0
    # The root of 1 - f sgn falls linearly with the distance, down to zero.
    left = np.sqrt(max(1.0 - share * side, 0.0)) - 0.5 * abs(moved) / creep
    left = max(left, 0.0)
    return float(side * (1.0 - left * left))


@jit_internal
def bouc_wen(share: float, moved: float, width: float) -> float:
    """Hysteresis by Bouc and Wen with exponent one: z' = (1 - z sgn) phi' / width, one backward Euler step."""
    way = abs(moved) / width
    side = 1.0 if moved >= 0.0 else -1.0
    return (share + side * way) / (1.0 + way)


@jit_internal
def dashpot_angle(slack: float, phi_before: float, phi: float, seconds: float, tau: float) -> float:
    """Angle of the dashpot in series with a spring, x' = (phi - x) / tau, by the trapezoid rule."""
    half = 0.5 * seconds / tau
    return (slack * (1.0 - half) + half * (phi_before + phi)) / (1.0 + half)


@jit_internal
def spring_torque(phi: float, hinge: Floats, i: int) -> float:
    """Torque of the spring of hinge `i` in N m, without friction and damping; `hinge` is (n, 18)."""
    x = phi - hinge[i, PRESET]
    gap = hinge[i, GAP]
    bent = x - gap if x > gap else (x + gap if x < -gap else 0.0)
    harder = 1.0 + hinge[i, ASYMMETRY] * (1.0 if bent > 0.0 else -1.0)
    return float(harder * hinge[i, K0] * bent * (1.0 + hinge[i, K2] * bent * bent))


@jit_internal
def hinge_torque(phi: float, moved: float, seconds: float, hinge: Floats, memory: Floats, i: int) -> float:
    """Total torque that resists at hinge `i` in N m, without damping; `hinge` is (n, 18), `memory` (n, 3).

    `moved` rad and `seconds` are counted from the last update of `memory`, which stays unchanged.
    """
    torque = spring_torque(phi, hinge, i)
    over = abs(phi) - hinge[i, STOP]
    if over > 0.0:
        torque += hinge[i, STOP_STIFFNESS] * over * (1.0 if phi > 0.0 else -1.0)
    if hinge[i, DETENT] != 0.0:
        torque += hinge[i, DETENT] * np.sin(hinge[i, DETENTS] * phi)
    # Dahl reaches full friction after 2 creep, so half of PIN_CREEP makes it full after PIN_CREEP.
    if hinge[i, PIN] != 0.0:
        torque += hinge[i, PIN] * dahl(memory[i, PIN_SHARE], moved, 0.5 * hinge[i, PIN_CREEP])
    if hinge[i, LOOP] != 0.0:
        torque += hinge[i, LOOP] * bouc_wen(memory[i, LOOP_SHARE], moved, hinge[i, LOOP_ANGLE])
    if hinge[i, ARM] != 0.0:
        torque += hinge[i, ARM] * (phi - dashpot_angle(memory[i, ARM_ANGLE], phi - moved, phi, seconds, hinge[i, ARM_TIME]))
    return float(torque)


@jit_internal
def update_hinge_memory(phi: float, moved: float, seconds: float, hinge: Floats, memory: Floats, i: int) -> None:
    """Update row `i` of `memory` (n, 3) after a step of `moved` rad in `seconds`; `hinge` is (n, 18)."""
    memory[i, PIN_SHARE] = dahl(memory[i, PIN_SHARE], moved, 0.5 * hinge[i, PIN_CREEP])
    memory[i, LOOP_SHARE] = bouc_wen(memory[i, LOOP_SHARE], moved, hinge[i, LOOP_ANGLE])
    memory[i, ARM_ANGLE] = dashpot_angle(memory[i, ARM_ANGLE], phi - moved, phi, seconds, hinge[i, ARM_TIME])
