"""What turns the shaft: the command, the motor that follows it, and what lies between motor and leg."""

import numpy as np
from numpy.typing import NDArray

from rfca_rig.exam.compiled import internal

Floats = NDArray[np.float64]

# entries of `drive` (16)
START, KP, KI, ROTOR, SHAFT, SHAFT_DAMPING, SHAFT_GAP, SHAFT_LOSS, RIPPLE, CYCLES, PHASE, CABLE, LIMIT, COGGING, COGS, HOSE = range(16)
# entries of `motor` (4): commanded angle and speed, the motor's angle and speed
TOLD, TOLD_SPEED, TURNED, TURNING = range(4)

CABLE_SPEED_RAD_S = 0.02  # speed at which a dragging cable pulls fully


@internal
def asked_speed(knots: Floats, t: float) -> float:
    """Commanded speed: straight lines through `knots` (2, m) of times and speeds, at rest before and after."""
    m = knots.shape[1]
    if t <= knots[0, 0] or t > knots[0, m - 1]:
        return 0.0
    i = np.searchsorted(knots[0], t)
    t0, t1 = knots[0, i - 1], knots[0, i]
    return float(knots[1, i - 1] + (knots[1, i] - knots[1, i - 1]) * (t - t0) / (t1 - t0))


@internal
def rippled(drive: Floats, angle: float, speed: float) -> float:
    """The speed that the command becomes at a shaft angle."""
    return float(speed * (1.0 + drive[RIPPLE] * np.cos(drive[CYCLES] * (angle - drive[START]) + drive[PHASE])))


@internal
def advance_command(drive: Floats, knots: Floats, motor: Floats, t: float, h: float) -> None:
    """One step of the commanded angle, by the midpoint rule."""
    begin = rippled(drive, motor[TOLD], asked_speed(knots, t))
    half = motor[TOLD] + 0.5 * h * begin
    motor[TOLD] += h * rippled(drive, half, asked_speed(knots, t + 0.5 * h))
    motor[TOLD_SPEED] = rippled(drive, motor[TOLD], asked_speed(knots, t + h))


@internal
def pushed(drive: Floats, motor: Floats, told_before: float, angle: float, speed: float, h: float) -> tuple[float, float]:
    """Torque of the PI loop in the middle of a step of `motor`, for a shaft at `angle` then and at `speed` before, and how much it falls
    with the speed: not at all where the motor gives what it can.
    """
    told = 0.5 * (told_before + motor[TOLD])
    asked = drive[KI] * (told - angle) + drive[KP] * ((motor[TOLD] - told_before) / h - speed)
    magnets = drive[COGGING] * np.sin(drive[COGS] * (angle - drive[START]))
    if abs(asked) > drive[LIMIT]:
        return (drive[LIMIT] if asked > 0.0 else -drive[LIMIT]) + magnets, 0.0
    return asked + magnets, drive[KP]


@internal
def twist(drive: Floats, angle: float, speed: float) -> tuple[float, float]:
    """Torque of the shaft between motor and leg, `angle` and `speed` of the one against the other, and how much it rises with the speed.

    Beyond a play the ends press with a loss that grows with the pressure, and never pull.
    """
    beyond = max(abs(angle) - drive[SHAFT_GAP], 0.0)
    side = 1.0 if angle > 0.0 else -1.0
    pressure = drive[SHAFT] * beyond
    towards = pressure * (1.0 + drive[SHAFT_LOSS] * side * speed)
    rising = drive[SHAFT_LOSS] * pressure if towards > 0.0 else 0.0
    return side * max(towards, 0.0) + drive[SHAFT_DAMPING] * speed, drive[SHAFT_DAMPING] + rising


@internal
def turn_rotor(drive: Floats, motor: Floats, told_before: float, back: float, h: float) -> float:
    """One step of a rotor under PI control against the torque `back` of the twisted shaft; returns the motor's torque."""
    angle = motor[TURNED] + 0.5 * h * motor[TURNING]
    push, falling = pushed(drive, motor, told_before, angle, motor[TURNING], h)
    gained = h * (push - back) / (drive[ROTOR] + 0.5 * h * falling)
    motor[TURNING] += gained
    motor[TURNED] = angle + 0.5 * h * motor[TURNING]
    return float(push - 0.5 * falling * gained)


@internal
def cable(drive: Floats, angle: float, speed: float) -> float:
    """What a cable drags at the shaft, and how a hose turns it back."""
    return float(-drive[CABLE] * np.tanh(speed / CABLE_SPEED_RAD_S) - drive[HOSE] * (angle - drive[START]))
