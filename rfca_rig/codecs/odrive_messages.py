"""Commands and messages between an ODrive and its master. Units are the drive's: motor turns, N m, A."""

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
    AXIS_STATE = 0x07
    ENCODER_ESTIMATES = 0x09
    CONTROLLER_MODE = 0x0B
    INPUT_POS = 0x0C
    INPUT_VEL = 0x0D
    INPUT_TORQUE = 0x0E
    IQ = 0x14
    TEMPERATURES = 0x15
    BUS_VOLTAGE_CURRENT = 0x17
    CLEAR_ERRORS = 0x18
    TORQUES = 0x1C


# A separate type, because the same numbers mean other commands in firmware 0.6.
class OlderCommand(IntEnum):
    """Commands of firmware 0.5 only; some have the numbers of other commands of 0.6."""

    MOTOR_ERROR = 0x03
    ENCODER_ERROR = 0x04
    CONTROLLER_ERROR = 0x1D


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
    """Firmware and hardware of the drive, as (major, minor, revision) and (major, minor, variant)."""

    firmware: tuple[int, int, int]
    hardware: tuple[int, int, int]
    protocol: int = 2
    unreleased: int = 0


@dataclass(frozen=True, slots=True)
class Heartbeat:
    """Sent by the drive on its own. `state` is an `AxisState` or one of the calibration states.

    `procedure_result` comes from firmware 0.6 only, `failed` (the parts that have an error of their own) from 0.5 only.
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
)
