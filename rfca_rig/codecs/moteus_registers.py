"""The registers of a moteus that are used here, and the scales of their values on the wire.

Source: moteus reference, "Register Usage". Units are the drive's: revolutions of its output, N m, A, V, degrees Celsius, seconds.
"""

from enum import IntEnum


class Width(IntEnum):
    """Encoding of a value; the drive accepts and sends every register in each of them."""

    INT8 = 0
    INT16 = 1
    INT32 = 2
    FLOAT = 3


class Register(IntEnum):
    MODE = 0x000
    POSITION = 0x001
    VELOCITY = 0x002
    TORQUE = 0x003
    Q_CURRENT = 0x004
    D_CURRENT = 0x005
    POWER = 0x007
    MOTOR_TEMPERATURE = 0x00A
    TRAJECTORY_COMPLETE = 0x00B
    HOME_STATE = 0x00C
    VOLTAGE = 0x00D
    TEMPERATURE = 0x00E
    FAULT = 0x00F
    COMMAND_POSITION = 0x020
    COMMAND_VELOCITY = 0x021
    COMMAND_FEEDFORWARD_TORQUE = 0x022
    COMMAND_KP_SCALE = 0x023
    COMMAND_KD_SCALE = 0x024
    COMMAND_MAXIMUM_TORQUE = 0x025
    COMMAND_STOP_POSITION = 0x026
    COMMAND_TIMEOUT = 0x027
    COMMAND_VELOCITY_LIMIT = 0x028
    COMMAND_ACCELERATION_LIMIT = 0x029
    CONTROL_POSITION = 0x038
    CONTROL_VELOCITY = 0x039
    MILLISECOND_COUNTER = 0x070
    MODEL_NUMBER = 0x100
    FIRMWARE_VERSION = 0x101
    REGISTER_MAP_VERSION = 0x102
    SERIAL_NUMBER_1 = 0x120
    SERIAL_NUMBER_2 = 0x121
    SERIAL_NUMBER_3 = 0x122


class Mode(IntEnum):
    """Values of the register MODE; 2..4 are transitions to a mode in which the motor is controlled."""

    STOPPED = 0
    FAULT = 1
    ENABLING = 2
    CALIBRATING = 3
    CALIBRATED = 4
    POSITION = 10
    TIMEOUT = 11
    ZERO_VELOCITY = 12
    BRAKE = 15


# Units per count as int8, int16, int32.
Counts = tuple[float, float, float]

_POSITION = (0.01, 0.0001, 0.00001)
_VELOCITY = (0.1, 0.00025, 0.00001)
_ACCELERATION = (0.05, 0.001, 0.00001)
_TORQUE = (0.5, 0.01, 0.001)
_CURRENT = (1.0, 0.1, 0.001)
_VOLTAGE = (0.5, 0.1, 0.001)
_TEMPERATURE = (1.0, 0.1, 0.001)
_TIME = (0.01, 0.001, 0.000001)
_SHARE = (1 / 127, 1 / 32767, 1 / 2147483647)
_POWER = (10.0, 0.05, 0.0001)

_SCALED: dict[int, Counts] = {
    Register.POSITION: _POSITION,
    Register.VELOCITY: _VELOCITY,
    Register.TORQUE: _TORQUE,
    Register.Q_CURRENT: _CURRENT,
    Register.D_CURRENT: _CURRENT,
    Register.POWER: _POWER,
    Register.MOTOR_TEMPERATURE: _TEMPERATURE,
    Register.VOLTAGE: _VOLTAGE,
    Register.TEMPERATURE: _TEMPERATURE,
    Register.COMMAND_POSITION: _POSITION,
    Register.COMMAND_VELOCITY: _VELOCITY,
    Register.COMMAND_FEEDFORWARD_TORQUE: _TORQUE,
    Register.COMMAND_KP_SCALE: _SHARE,
    Register.COMMAND_KD_SCALE: _SHARE,
    Register.COMMAND_MAXIMUM_TORQUE: _TORQUE,
    Register.COMMAND_STOP_POSITION: _POSITION,
    Register.COMMAND_TIMEOUT: _TIME,
    Register.COMMAND_VELOCITY_LIMIT: _VELOCITY,
    Register.COMMAND_ACCELERATION_LIMIT: _ACCELERATION,
    Register.CONTROL_POSITION: _POSITION,
    Register.CONTROL_VELOCITY: _VELOCITY,
}


def units_per_count(register: int, width: Width) -> float | None:
    """Size of one count where the register holds a physical quantity; None for a plain whole number, and for a float."""
    scale = _SCALED.get(register)
    return None if scale is None or width == Width.FLOAT else scale[width]


def name_of(register: int) -> str:
    """Name of a register for messages, or its number where it is not known here."""
    return Register(register).name if register in set(Register) else f"register 0x{register:03x}"
