"""Commands and messages between an ODrive and its master, and the meanings of its states and error
words, for both firmware dialects.

Units are the drive's: motor turns, N m, A.

Sources: firmware 0.6, ODrive API reference, ODrive.Error and ProcedureResult; firmware 0.5, 0.5.6
API reference, Axis, Motor, Encoder and Controller errors.
"""

from dataclasses import dataclass
from enum import IntEnum, StrEnum

# Also the address of a drive that has none yet.
BROADCAST_NODE = 0x3F


class OdriveFirmware(StrEnum):
    """Firmware of the drive: 0.5 (as of 0.5.6, ODrive v3) or 0.6 (ODrive Pro, S1, Micro)."""

    V0_5 = "0.5"
    V0_6 = "0.6"


class OdrivePart(StrEnum):
    """Parts that have their own error word in firmware 0.5."""

    MOTOR = "motor"
    ENCODER = "encoder"
    CONTROLLER = "controller"


class OdriveCommand(IntEnum):
    """The low five bits of an arbitration id."""

    VERSION = 0x00
    HEARTBEAT = 0x01
    ESTOP = 0x02
    ERRORS = 0x03
    RX_SDO = 0x04
    TX_SDO = 0x05
    ADDRESS = 0x06
    AXIS_STATE = 0x07
    ENCODER_ESTIMATES = 0x09
    CONTROLLER_MODE = 0x0B
    INPUT_POS = 0x0C
    INPUT_VEL = 0x0D
    INPUT_TORQUE = 0x0E
    IQ = 0x14
    TEMPERATURES = 0x15
    REBOOT = 0x16
    BUS_VOLTAGE_CURRENT = 0x17
    CLEAR_ERRORS = 0x18
    TORQUES = 0x1C


# A separate type, because the same numbers mean other commands in firmware 0.6.
class OlderCommand(IntEnum):
    """Commands of firmware 0.5 only; some have the numbers of other commands of 0.6."""

    MOTOR_ERROR = 0x03
    ENCODER_ERROR = 0x04
    CONTROLLER_ERROR = 0x1D


class SdoOpcode(IntEnum):
    """What a master asks of an endpoint."""

    READ = 0
    WRITE = 1


class RebootAction(IntEnum):
    """What a drive does with its settings before it starts again."""

    REBOOT = 0
    SAVE_CONFIGURATION = 1
    ERASE_CONFIGURATION = 2


class AxisState(IntEnum):
    IDLE = 1
    CLOSED_LOOP = 8


class ControlMode(IntEnum):
    TORQUE = 1
    VELOCITY = 2
    POSITION = 3


# Input mode in which set-points act without filter or ramp.
PASSTHROUGH = 1


@dataclass(frozen=True, slots=True)
class Version:
    """Firmware and hardware of the drive, as (major, minor, revision) and (major, minor,
    variant).
    """

    firmware: tuple[int, int, int]
    hardware: tuple[int, int, int]
    protocol: int = 2
    unreleased: int = 0


@dataclass(frozen=True, slots=True)
class Heartbeat:
    """Sent by the drive on its own. `state` is an `AxisState` or one of the calibration states.

    `procedure_result` comes from firmware 0.6 only, `failed` (the parts that have an error of their
    own) from 0.5 only.
    """

    error: int
    state: int
    procedure_result: int
    trajectory_done: bool
    failed: tuple[OdrivePart, ...] = ()


@dataclass(frozen=True, slots=True)
class ErrorReport:
    active_errors: int
    disarm_reason: int


@dataclass(frozen=True, slots=True)
class PartError:
    """The error word of one part; firmware 0.5."""

    part: OdrivePart
    word: int


@dataclass(frozen=True, slots=True)
class EncoderEstimates:
    position_turns: float
    speed_turns_s: float


@dataclass(frozen=True, slots=True)
class Iq:
    setpoint_A: float
    measured_A: float


@dataclass(frozen=True, slots=True)
class Torques:
    target_Nm: float
    estimate_Nm: float


@dataclass(frozen=True, slots=True)
class Temperatures:
    inverter_degC: float
    motor_degC: float


@dataclass(frozen=True, slots=True)
class BusPower:
    voltage_V: float
    current_A: float


@dataclass(frozen=True, slots=True)
class Estop:
    pass


@dataclass(frozen=True, slots=True)
class ClearErrors:
    pass


@dataclass(frozen=True, slots=True)
class SetAxisState:
    state: int


@dataclass(frozen=True, slots=True)
class SetControllerMode:
    control_mode: int
    input_mode: int


@dataclass(frozen=True, slots=True)
class SetInputPos:
    """`speed_turns_s` and `torque_Nm` feed forward, in steps of 0.001."""

    position_turns: float
    speed_turns_s: float
    torque_Nm: float


@dataclass(frozen=True, slots=True)
class SetInputVel:
    speed_turns_s: float
    torque_Nm: float


@dataclass(frozen=True, slots=True)
class SetInputTorque:
    torque_Nm: float


@dataclass(frozen=True, slots=True)
class RxSdo:
    """To the drive: read an endpoint, or write these bytes to it; firmware 0.6."""

    opcode: int
    endpoint_id: int
    value: bytes = b""


@dataclass(frozen=True, slots=True)
class TxSdo:
    """From the drive: the bytes of an endpoint, four where it has fewer; firmware 0.6."""

    endpoint_id: int
    value: bytes


@dataclass(frozen=True, slots=True)
class Address:
    """From a drive: its node id. To all drives: the one of this serial number takes the node id.
    Firmware 0.6.
    """

    node_id: int
    serial_number: int


@dataclass(frozen=True, slots=True)
class Reboot:
    """`action` is a `RebootAction`; firmware 0.5 knows the first of them only."""

    action: int = 0


Message = (
    Version
    | Heartbeat
    | ErrorReport
    | PartError
    | EncoderEstimates
    | Iq
    | Torques
    | Temperatures
    | BusPower
    | Estop
    | ClearErrors
    | SetAxisState
    | SetControllerMode
    | SetInputPos
    | SetInputVel
    | SetInputTorque
    | RxSdo
    | TxSdo
    | Address
    | Reboot
)


ERROR_BITS = {
    0: ("INITIALIZING", "the drive is still starting up"),
    1: ("SYSTEM_LEVEL", "firmware failure inside the drive"),
    2: ("TIMING_ERROR", "the drive's control loop missed its deadline"),
    3: ("MISSING_ESTIMATE", "no valid encoder position or calibration"),
    4: ("BAD_CONFIG", "the drive's configuration is incomplete or contradicts itself"),
    5: ("DRV_FAULT", "the gate driver chip reports a fault"),
    6: ("MISSING_INPUT", "no set-point was given"),
    8: ("DC_BUS_OVER_VOLTAGE", "supply voltage above its limit; check the brake resistor"),
    9: ("DC_BUS_UNDER_VOLTAGE", "supply voltage below its limit; check the power supply"),
    10: ("DC_BUS_OVER_CURRENT", "supply current above its limit"),
    11: ("DC_BUS_OVER_REGEN_CURRENT", "current fed back into the supply above its limit"),
    12: ("CURRENT_LIMIT_VIOLATION", "motor current above its limit"),
    13: ("MOTOR_OVER_TEMP", "motor too hot"),
    14: ("INVERTER_OVER_TEMP", "inverter too hot"),
    15: ("VELOCITY_LIMIT_VIOLATION", "motor faster than its limit"),
    16: ("POSITION_LIMIT_VIOLATION", "position outside its limits"),
    17: ("REQUESTED_CURRENT_TOO_HIGH", "the configured current is more than the drive can give"),
    24: ("WATCHDOG_TIMER_EXPIRED", "no command reached the drive in time"),
    25: ("ESTOP_REQUESTED", "emergency stop pressed or sent"),
    26: (
        "SPINOUT_DETECTED",
        "electrical and mechanical power disagree; encoder slipping or miscalibrated",
    ),
    27: ("BRAKE_RESISTOR_DISARMED", "the brake resistor is off"),
    28: ("THERMISTOR_DISCONNECTED", "a thermistor is not connected"),
    30: ("CALIBRATION_ERROR", "the calibration failed"),
}

_AXIS_BITS_0_5 = {
    0: ("INVALID_STATE", "the state asked for cannot be entered; is the motor calibrated?"),
    6: ("MOTOR_FAILED", "see the motor's own error"),
    7: ("SENSORLESS_ESTIMATOR_FAILED", "see the estimator's own error"),
    8: ("ENCODER_FAILED", "see the encoder's own error"),
    9: ("CONTROLLER_FAILED", "see the controller's own error"),
    11: ("WATCHDOG_TIMER_EXPIRED", "no command reached the drive in time"),
    12: ("MIN_ENDSTOP_PRESSED", "the lower end stop was touched"),
    13: ("MAX_ENDSTOP_PRESSED", "the upper end stop was touched"),
    14: ("ESTOP_REQUESTED", "emergency stop pressed or sent"),
    17: ("HOMING_WITHOUT_ENDSTOP", "homing needs an end stop"),
    18: ("OVER_TEMP", "drive or motor too hot"),
    19: ("UNKNOWN_POSITION", "no valid position; run the calibration"),
}

# The two dialects use different bits for the same error.
WATCHDOG_EXPIRED = {OdriveFirmware.V0_5: 1 << 11, OdriveFirmware.V0_6: 1 << 24}
ESTOP_REQUESTED = {OdriveFirmware.V0_5: 1 << 14, OdriveFirmware.V0_6: 1 << 25}
OVER_TEMPERATURE = {OdriveFirmware.V0_5: 1 << 18, OdriveFirmware.V0_6: 1 << 13}
# Firmware 0.6 alone.
MISSING_INPUT = 1 << 6
# Bit of the motor's error word; firmware 0.5 alone.
MODULATION_IS_NAN = 1 << 16

_PART_BITS = {
    OdrivePart.MOTOR: {
        0: ("PHASE_RESISTANCE_OUT_OF_RANGE", "check the motor's wires"),
        1: ("PHASE_INDUCTANCE_OUT_OF_RANGE", "check the motor's wires"),
        3: ("DRV_FAULT", "the gate driver chip reports a fault"),
        4: (
            "CONTROL_DEADLINE_MISSED",
            "the control loop missed its deadline; mostly follows another error",
        ),
        7: ("MODULATION_MAGNITUDE", "supply voltage too low for this speed or current"),
        10: ("CURRENT_SENSE_SATURATION", "current beyond what can be measured"),
        12: ("CURRENT_LIMIT_VIOLATION", "motor current above its limit"),
        16: ("MODULATION_IS_NAN", "a set-point was not a number"),
        17: ("MOTOR_THERMISTOR_OVER_TEMP", "motor too hot"),
        18: ("FET_THERMISTOR_OVER_TEMP", "inverter too hot"),
        19: ("TIMER_UPDATE_MISSED", "firmware failure inside the drive"),
        20: ("CURRENT_MEASUREMENT_UNAVAILABLE", "firmware failure inside the drive"),
        21: ("CONTROLLER_FAILED", "see the controller's own error"),
        22: ("I_BUS_OUT_OF_RANGE", "supply current outside its limits"),
        23: ("BRAKE_RESISTOR_DISARMED", "the brake resistor is off"),
        24: ("SYSTEM_LEVEL", "see the drive's own error, mostly supply voltage or current"),
        25: ("BAD_TIMING", "the control loop missed its deadline"),
        26: ("UNKNOWN_PHASE_ESTIMATE", "no valid encoder position; run the calibration"),
        27: ("UNKNOWN_PHASE_VEL", "no valid encoder speed"),
        28: ("UNKNOWN_TORQUE", "the controller gave no torque"),
        29: ("UNKNOWN_CURRENT_COMMAND", "no current was asked for"),
        30: ("UNKNOWN_CURRENT_MEASUREMENT", "current not measured"),
        31: ("UNKNOWN_VBUS_VOLTAGE", "supply voltage not measured"),
        32: ("UNKNOWN_VOLTAGE_COMMAND", "no voltage was asked for"),
        33: ("UNKNOWN_GAINS", "run the motor calibration"),
        34: ("CONTROLLER_INITIALIZING", "the drive is still starting up"),
        35: ("UNBALANCED_PHASES", "check the motor's wires"),
    },
    OdrivePart.ENCODER: {
        0: ("UNSTABLE_GAIN", "the encoder's bandwidth is set too high"),
        1: ("CPR_POLEPAIRS_MISMATCH", "pole pairs and counts per turn do not match"),
        2: ("NO_RESPONSE", "no change seen while the motor turned; check the encoder's wires"),
        3: ("UNSUPPORTED_ENCODER_MODE", "set another encoder mode"),
        4: ("ILLEGAL_HALL_STATE", "check the Hall sensors' wires"),
        5: ("INDEX_NOT_FOUND_YET", "turn to the encoder's index first"),
        6: ("ABS_SPI_TIMEOUT", "the absolute encoder does not answer"),
        7: ("ABS_SPI_COM_FAIL", "the absolute encoder's answers are damaged"),
        8: ("ABS_SPI_NOT_READY", "the absolute encoder is not ready"),
        9: ("HALL_NOT_CALIBRATED_YET", "run the Hall calibration"),
    },
    OdrivePart.CONTROLLER: {
        0: ("OVERSPEED", "motor faster than its limit"),
        1: ("INVALID_INPUT_MODE", "set another input mode"),
        2: ("UNSTABLE_GAIN", "the gains are set too high"),
        3: ("INVALID_MIRROR_AXIS", "set another axis to mirror"),
        4: ("INVALID_LOAD_ENCODER", "set another load encoder"),
        5: ("INVALID_ESTIMATE", "no valid encoder position or speed"),
        6: ("INVALID_CIRCULAR_RANGE", "set another circular range"),
        7: (
            "SPINOUT_DETECTED",
            "electrical and mechanical power disagree; encoder slipping or miscalibrated",
        ),
    },
}

STATES = {
    0: "undefined",
    1: "idle",
    2: "startup sequence",
    3: "full calibration",
    4: "motor calibration",
    5: "sensorless control",
    6: "encoder index search",
    7: "encoder offset calibration",
    8: "closed loop",
    9: "lock-in spin",
    10: "encoder direction search",
    11: "homing",
    12: "hall polarity calibration",
    13: "hall phase calibration",
    14: "anticogging calibration",
}

PROCEDURE_RESULTS = {
    0: "success",
    1: "busy",
    2: "cancelled",
    3: "disarmed",
    4: "no response",
    5: "pole pairs and counts per turn do not match",
    6: "phase resistance out of range",
    7: "phase inductance out of range",
    8: "unbalanced phases",
    9: "invalid motor type",
    10: "illegal hall state",
    11: "timeout",
    12: "homing without endstop",
    13: "invalid state",
    14: "not calibrated",
    15: "not converging",
    16: "requested current too high",
}


def error_text(word: int, firmware: OdriveFirmware) -> str:
    """The axis error word in hexadecimal with the name and meaning of every bit that is set."""
    if firmware == OdriveFirmware.V0_6:
        bits = ERROR_BITS
    else:
        bits = _AXIS_BITS_0_5
    return f"error 0x{word:08x} ({_describe_bits(word, bits)})"


def part_error_text(part: OdrivePart, word: int) -> str:
    """The same for the error word of one part, 64 bits for the motor's; firmware 0.5 alone."""
    return f"{part} error 0x{word:08x} ({_describe_bits(word, _PART_BITS[part])})"


def _describe_bits(word: int, bits: dict[int, tuple[str, str]]) -> str:
    known = (
        bits.get(bit, (f"bit {bit}", "not documented")) for bit in range(64) if word >> bit & 1
    )
    return "; ".join(f"{name}: {meaning}" for name, meaning in known) or "none"


def state_text(state: int) -> str:
    return STATES.get(state, f"state {state}")


def result_text(result: int) -> str:
    return PROCEDURE_RESULTS.get(result, f"result {result}")
