"""The shaft's drive: the command, the motor that follows it, and the transmission between motor and leg."""

import numpy as np
from numpy.typing import NDArray

from rfca_rig.exam.compiled import jit_internal

Floats = NDArray[np.float64]

# entries of `drive` (16)
START, KP, KI, ROTOR, SHAFT, SHAFT_DAMPING, SHAFT_GAP, SHAFT_LOSS, RIPPLE, CYCLES, PHASE, CABLE, LIMIT, COGGING, COGS, HOSE = range(16)
# entries of `motor` (4): commanded angle and speed, the motor's angle and speed
COMMAND_ANGLE, COMMAND_SPEED, MOTOR_ANGLE, MOTOR_SPEED = range(4)

# Speed of the regularised sign: at a few times this, a dragging cable pulls fully.
CABLE_SPEED_RAD_S = 0.02


@jit_internal
def command_speed(knots: Floats, t: float) -> float:
    """Commanded speed in rad/s: linear between `knots` (2, m) of times and speeds, at rest before and after."""
    m = knots.shape[1]
    if t <= knots[0, 0] or t > knots[0, m - 1]:
        return 0.0
    i = np.searchsorted(knots[0], t)
    t0, t1 = knots[0, i - 1], knots[0, i]
    return float(knots[1, i - 1] + (knots[1, i] - knots[1, i - 1]) * (t - t0) / (t1 - t0))


@jit_internal
def add_ripple(drive: Floats, angle: float, speed: float) -> float:
    """Commanded speed at a shaft angle, with the speed ripple of `drive` (16,)."""
    return float(speed * (1.0 + drive[RIPPLE] * np.cos(drive[CYCLES] * (angle - drive[START]) + drive[PHASE])))


@jit_internal
def advance_command(drive: Floats, knots: Floats, motor: Floats, t: float, h: float) -> None:
    """Advance the commanded angle and speed in `motor` (4,) by one step, by the midpoint rule; `knots` is (2, m)."""
    begin = add_ripple(drive, motor[COMMAND_ANGLE], command_speed(knots, t))
    half = motor[COMMAND_ANGLE] + 0.5 * h * begin
    motor[COMMAND_ANGLE] += h * add_ripple(drive, half, command_speed(knots, t + 0.5 * h))
    motor[COMMAND_SPEED] = add_ripple(drive, motor[COMMAND_ANGLE], command_speed(knots, t + h))


@jit_internal
def pi_torque(drive: Floats, motor: Floats, told_before: float, angle: float, speed: float, h: float) -> tuple[float, float]:
    """Torque of the PI speed loop at mid-step in N m, and by how much it falls per rad/s of speed.

    `drive` is (16,), `motor` (4,) with the command after the step, `told_before` the commanded angle before it. `angle` is the
    rotor's at mid-step, `speed` before the step.
    """
    command = 0.5 * (told_before + motor[COMMAND_ANGLE])
    demand = drive[KI] * (command - angle) + drive[KP] * ((motor[COMMAND_ANGLE] - told_before) / h - speed)
    cogging = drive[COGGING] * np.sin(drive[COGS] * (angle - drive[START]))
    # A saturated motor no longer reacts to speed, so its implicit share is zero.
    if abs(demand) > drive[LIMIT]:
        return (drive[LIMIT] if demand > 0.0 else -drive[LIMIT]) + cogging, 0.0
    return demand + cogging, drive[KP]


@jit_internal
def shaft_torque(drive: Floats, angle: float, speed: float) -> tuple[float, float]:
    """Torque of the shaft between motor and leg in N m, and by how much it rises per rad/s of relative speed.

    `drive` is (16,); `angle` and `speed` are those of the motor relative to the leg. Beyond the play the ends press on each other with
    a loss that grows with the pressure; they never pull.
    """
    beyond = max(abs(angle) - drive[SHAFT_GAP], 0.0)
    side = 1.0 if angle > 0.0 else -1.0
    pressure = drive[SHAFT] * beyond
    towards = pressure * (1.0 + drive[SHAFT_LOSS] * side * speed)
    rising = drive[SHAFT_LOSS] * pressure if towards > 0.0 else 0.0
    return side * max(towards, 0.0) + drive[SHAFT_DAMPING] * speed, drive[SHAFT_DAMPING] + rising


@jit_internal
def turn_rotor(drive: Floats, motor: Floats, told_before: float, back: float, h: float) -> float:
    """Advance a rotor under PI control by one step, in `motor` (4,); returns the motor's torque in N m.

    `back` is the torque of the twisted shaft on the rotor, `told_before` the commanded angle before the step.
    """
    angle = motor[MOTOR_ANGLE] + 0.5 * h * motor[MOTOR_SPEED]
    push, falling = pi_torque(drive, motor, told_before, angle, motor[MOTOR_SPEED], h)
    # Implicit in the falling torque: stiff controllers would otherwise limit the step.
    gained = h * (push - back) / (drive[ROTOR] + 0.5 * h * falling)
    motor[MOTOR_SPEED] += gained
    motor[MOTOR_ANGLE] = angle + 0.5 * h * motor[MOTOR_SPEED]
    return float(push - 0.5 * falling * gained)


@jit_internal
def cable_drag_torque(drive: Floats, angle: float, speed: float) -> float:
    """Torque in N m of a dragging cable and of a hose that turns the shaft back to its start; `drive` is (16,)."""
    return float(-drive[CABLE] * np.tanh(speed / CABLE_SPEED_RAD_S) - drive[HOSE] * (angle - drive[START]))
