"""Servo mode of a CubeMars / T-Motor AK drive, both directions; pure.

Layout: AK Series Module Driver Manual V1.0.8 (p. 32-40) and V1.0.18 (p. 35-45). Extended frames,
big-endian, id = packet << 8 | drive id. Speeds are electrical: revolutions per minute of the motor
times its pole pairs (ERPM). Three traps of older drivers:

- Positions are in steps of 1e-4 degrees (an older printing has 1e-6).
- Speed and acceleration of the position-speed packet are in steps of 10, its position is not.
- The status frame is 0x29; 0x2C and 0x09 are none.
"""

import struct
from collections.abc import Callable
from dataclasses import dataclass
from enum import IntEnum

from rfca_rig.errors import MalformedFrame, NotEncodable

Frame = tuple[int, bytes]

MAX_ERPM = 100_000
MAX_DEG = 36_000.0
MAX_A = 60.0
STATUS_COUNTS = 1 << 16
# Per count of the status frame.
STATUS_DEG = 0.1
STATUS_ERPM = 10.0
STATUS_A = 0.01


class Packet(IntEnum):
    """Packet types: the arbitration id above its low byte."""

    DUTY = 0
    CURRENT = 1
    CURRENT_BRAKE = 2
    SPEED = 3
    POSITION = 4
    ORIGIN = 5
    POSITION_SPEED = 6
    STATUS = 0x29


class OriginMode(IntEnum):
    """Lifetime of a new origin: until power-off; permanent (drives with two encoders); back to
    the factory's.
    """

    TEMPORARY = 0
    PERMANENT = 1
    FACTORY = 2


@dataclass(frozen=True, slots=True)
class SetDuty:
    duty: float


@dataclass(frozen=True, slots=True)
class SetCurrent:
    """A motor current. 0 removes the torque: the mode has no other frame for that."""

    current_A: float


@dataclass(frozen=True, slots=True)
class SetCurrentBrake:
    current_A: float


@dataclass(frozen=True, slots=True)
class SetSpeed:
    speed_erpm: int


@dataclass(frozen=True, slots=True)
class SetPosition:
    """A position of the output shaft, to be reached as fast as the drive can."""

    position_deg: float


@dataclass(frozen=True, slots=True)
class SetOrigin:
    origin: int


@dataclass(frozen=True, slots=True)
class SetPositionSpeed:
    """A position with limits of speed and acceleration."""

    position_deg: float
    speed_erpm: int
    acceleration_erpm_s: int


@dataclass(frozen=True, slots=True)
class Status:
    """Sent by the drive on its own. `position_count` is in steps of 0.1 degrees, 16 bits: it
    wraps after nine turns either way.
    """

    position_count: int
    speed_erpm: float
    current_A: float
    temperature_degC: int
    error: int


Message = (
    SetDuty
    | SetCurrent
    | SetCurrentBrake
    | SetSpeed
    | SetPosition
    | SetOrigin
    | SetPositionSpeed
    | Status
)

_LONG = struct.Struct(">i")
_BYTE = struct.Struct(">B")
_LONG_SHORTS = struct.Struct(">ihh")
_STATUS = struct.Struct(">hhhbB")

_LAYOUTS: dict[int, tuple[struct.Struct, Callable[..., Message]]] = {
    Packet.DUTY: (_LONG, lambda duty: SetDuty(1e-5 * duty)),
    Packet.CURRENT: (_LONG, lambda current: SetCurrent(1e-3 * current)),
    Packet.CURRENT_BRAKE: (_LONG, lambda current: SetCurrentBrake(1e-3 * current)),
    Packet.SPEED: (_LONG, SetSpeed),
    Packet.POSITION: (_LONG, lambda position: SetPosition(1e-4 * position)),
    Packet.ORIGIN: (_BYTE, SetOrigin),
    Packet.POSITION_SPEED: (
        _LONG_SHORTS,
        lambda position, speed, rate: SetPositionSpeed(1e-4 * position, 10 * speed, 10 * rate),
    ),
    Packet.STATUS: (
        _STATUS,
        lambda count, speed, current, *rest: Status(
            count, STATUS_ERPM * speed, STATUS_A * current, *rest
        ),
    ),
}


def decode(arbitration_id: int, data: bytes | bytearray) -> Message | None:
    """The message in one extended frame; None for a packet that is not used here. Raises
    MalformedFrame for a wrong length.
    """
    layout = _LAYOUTS.get(arbitration_id >> 8)
    if layout is None:
        return None
    fields, message = layout
    if len(data) != fields.size:
        name = Packet(arbitration_id >> 8).name
        raise MalformedFrame(
            f"CAN frame 0x{arbitration_id:08x} ({name}) has {len(data)} bytes, expected "
            f"{fields.size}; does the drive speak servo mode?"
        )
    return message(*fields.unpack(data))


def drive_of(arbitration_id: int) -> int:
    """The id of the drive that sent a frame, or that the frame is for."""
    return arbitration_id & 0xFF


def set_duty(drive: int, duty: float) -> Frame:
    return _frame(drive, Packet.DUTY, _LONG, _steps(duty, 1e-5, 1.0, "duty"))


def set_current(drive: int, current_A: float) -> Frame:
    return _frame(drive, Packet.CURRENT, _LONG, _steps(current_A, 1e-3, MAX_A, "current in A"))


def set_current_brake(drive: int, current_A: float) -> Frame:
    return _frame(
        drive, Packet.CURRENT_BRAKE, _LONG, _steps(current_A, 1e-3, MAX_A, "current in A")
    )


def set_speed(drive: int, speed_erpm: float) -> Frame:
    return _frame(drive, Packet.SPEED, _LONG, _steps(speed_erpm, 1.0, MAX_ERPM, "speed in ERPM"))


def set_position(drive: int, position_deg: float) -> Frame:
    return _frame(
        drive, Packet.POSITION, _LONG, _steps(position_deg, 1e-4, MAX_DEG, "position in degrees")
    )


def set_origin(drive: int, origin: OriginMode) -> Frame:
    return _frame(drive, Packet.ORIGIN, _BYTE, origin)


def set_position_speed(
    drive: int, position_deg: float, speed_erpm: float, acceleration_erpm_s: float
) -> Frame:
    """A position with limits of speed and acceleration, both in steps of 10 and at most 327 670."""
    # 16-bit fields: 32 767 steps of 10.
    steps = (
        _steps(position_deg, 1e-4, MAX_DEG, "position in degrees"),
        _steps(speed_erpm, 10.0, 327_670.0, "speed in ERPM"),
        _steps(acceleration_erpm_s, 10.0, 327_670.0, "acceleration in ERPM/s"),
    )
    return _frame(drive, Packet.POSITION_SPEED, _LONG_SHORTS, *steps)


def status(drive: int, report: Status) -> Frame:
    speed = _steps(report.speed_erpm, STATUS_ERPM, 327_670.0, "speed in ERPM")
    current = _steps(report.current_A, STATUS_A, 327.67, "current in A")
    return _frame(
        drive,
        Packet.STATUS,
        _STATUS,
        report.position_count,
        speed,
        current,
        report.temperature_degC,
        report.error,
    )


def _frame(drive: int, packet: Packet, fields: struct.Struct, *values: int) -> Frame:
    if not 0 <= drive <= 0xFF:
        raise NotEncodable(f"CAN drive id {drive} does not exist; ids go from 0 to 255")
    try:
        return packet << 8 | drive, fields.pack(*values)
    except struct.error as error:
        raise NotEncodable(
            f"CAN {packet.name} to drive {drive} cannot carry {values}: {error}"
        ) from error


def _steps(value: float, step: float, limit: float, name: str) -> int:
    # Written with `not`, so that NaN is refused too.
    if not abs(value) <= limit:
        raise NotEncodable(f"{name} {value:g} does not fit its field, limit {limit:g}")
    return round(value / step)
