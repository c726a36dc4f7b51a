"""The registers of a moteus that are used here, and the scales of their values on the wire.

Source: moteus reference, "Register Usage". Units are the drive's: revolutions of its output, N m, A, V, degrees Celsius, seconds.
"""

from enum import IntEnum

MODES = {
    0: "stopped",
    1: "fault",
    2: "enabling",
    3: "calibrating",
    4: "calibration complete",
    5: "PWM",
    6: "voltage",
    7: "voltage FOC",
    8: "voltage DQ",
    9: "current",
    10: "position",
    11: "timeout",
    12: "zero velocity",
    13: "stay within",
    14: "measure inductance",
    15: "brake",
}

FAULTS = {
    32: ("calibration fault", "the encoder sensed no magnet during calibration"),
    33: ("motor driver fault", "mostly the supply sagged under the current drawn; see the drv8323 diagnostics"),
    34: ("over voltage", "supply above servo.max_voltage; check its setting, and where braking power goes"),
    35: ("encoder fault", "the encoder's readings do not fit a magnet in place"),
    36: ("motor not configured", "run moteus_tool --calibrate on this motor"),
    37: ("pwm cycle overrun", "an internal error of the firmware"),
    38: ("over temperature", "board or motor above its limit; let it cool"),
    39: ("outside limit", "started outside servopos.position_min .. position_max"),
    40: ("under voltage", "supply too low; check the power supply"),
    41: ("config changed", "a setting was changed that needs a stop first"),
    42: ("theta invalid", "no valid encoder for commutation"),
    43: ("position invalid", "no valid encoder of the output"),
    44: ("driver enable fault", "the gate driver could not be switched on"),
    45: ("stop position deprecated", "a stop position was given together with velocity or acceleration limits"),
    46: ("timing violation", "the firmware broke a time limit of its own"),
    47: ("bemf feedforward no accel", "servo.bemf_feedforward is set without an acceleration limit"),
    48: ("invalid limits", "servopos.position_min or position_max lie outside the range available"),
}

# Codes in the fault register that are no faults: a function that limits the output while the drive runs.
LIMITS = {
    96: "servo.max_velocity",
    97: "servo.max_power_W",
    98: "the supply's voltage",
    99: "servo.max_current_A",
    100: "servo.fault_temperature",
    101: "servo.motor_fault_temperature",
    102: "the commanded maximum torque",
    103: "servopos.position_min or position_max",
}

REGISTER_ERRORS = {1: "unknown register", 2: "not writeable", 3: "value not allowed"}


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


def mode_text(mode: int) -> str:
    return MODES.get(mode, f"mode {mode}")


def fault_text(code: int) -> str:
    """The code of register 0x00f with its name and meaning; codes of limiting functions are described as limits."""
    if code in LIMITS:
        return f"limit {code} (output limited by {LIMITS[code]})"
    name, meaning = FAULTS.get(code, ("not documented", "see the firmware's release notes"))
    return f"fault {code} ({name}: {meaning})"


def register_error_text(code: int) -> str:
    return REGISTER_ERRORS.get(code, f"error {code}")
