"""MIT mode of a CubeMars / T-Motor AK drive, both directions; pure.

Layout: AK Series Module Driver Manual V1.0.8 (p. 48-50) and V1.0.18 (p. 60-68). It is that of Ben
Katz's motorcontrol firmware (Core/Src/can.c), its origin. Standard frames, bits packed without
gaps, the highest first:

    command, to the drive's id:  position 16, speed 12, kp 12, kd 12, torque 12
    reply:                       drive id 8, position 16, speed 12, torque 12,
                                 then temperature 8 and error 8 where the firmware has them

The drive replies once to every frame and never on its own. The reply's arbitration id is 0 or the
drive's, so the first byte identifies the drive. A value is min + code * (max - min) / (2^n - 1).
There is no code for zero: the two nearest are half a count off.
"""

from dataclasses import dataclass
from enum import Enum
from math import floor

from rfca_rig.devices.cubemars.codec import GAIN_Nm_PER_RAD, GAIN_Nm_S_PER_RAD, MitRanges
from rfca_rig.errors import MalformedFrame, NotEncodable

POSITION_CODES = 1 << 16
# Without temperature and error; with the supply voltage instead (Katz); with both.
REPLY_LENGTHS = frozenset({6, 7, 8})

_SPECIAL = b"\xff" * 7


class Special(Enum):
    """Special frames: the last byte after seven times 0xFF. ZERO sets the present position to 0;
    the drive is silent for about 1 s.
    """

    ENTER = 0xFC
    EXIT = 0xFD
    ZERO = 0xFE


@dataclass(frozen=True, slots=True)
class MitCommand:
    """Set-points at the output shaft. The torque is kp (position - actual) + kd (speed - actual)
    + `torque_Nm`.
    """

    position_rad: float
    speed_rad_s: float
    kp_Nm_per_rad: float
    kd_Nm_s_per_rad: float
    torque_Nm: float


@dataclass(frozen=True, slots=True)
class MitReply:
    """State of the drive. `position_code` is the raw position. Temperature and error are None
    where the firmware sends none.
    """

    drive_id: int
    position_code: int
    position_rad: float
    speed_rad_s: float
    torque_Nm: float
    temperature_degC: int | None
    error: int | None


def encode_command(ranges: MitRanges, command: MitCommand) -> bytes:
    """Encode a command with the nearest codes. Raises NotEncodable for a value outside its
    range, with the limit.
    """
    p = _code(
        command.position_rad, -ranges.position_rad, ranges.position_rad, 16, "position in rad"
    )
    v = _code(command.speed_rad_s, -ranges.speed_rad_s, ranges.speed_rad_s, 12, "speed in rad/s")
    kp = _code(command.kp_Nm_per_rad, 0.0, GAIN_Nm_PER_RAD, 12, "kp in N m/rad")
    kd = _code(command.kd_Nm_s_per_rad, 0.0, GAIN_Nm_S_PER_RAD, 12, "kd in N m s/rad")
    t = _code(command.torque_Nm, -ranges.torque_Nm, ranges.torque_Nm, 12, "torque in N m")
    data = _pack(p, v, kp, kd, t)
    # All fields at their maximum look like a special frame: one count less of the position avoids
    # that.
    if data[:7] == _SPECIAL:
        return _pack(p - 1, v, kp, kd, t)
    return data


def encode_special(special: Special) -> bytes:
    return _SPECIAL + bytes([special.value])


def decode_command(ranges: MitRanges, data: bytes | bytearray) -> MitCommand | Special:
    """Decode a command or special frame. Raises MalformedFrame for a wrong length."""
    if len(data) != 8:
        raise MalformedFrame(f"MIT command of {len(data)} bytes, expected 8")
    if bytes(data[:7]) == _SPECIAL and data[7] in {special.value for special in Special}:
        return Special(data[7])
    word = int.from_bytes(data, "big")
    return MitCommand(
        _value(word >> 48, -ranges.position_rad, ranges.position_rad, 16),
        _value(word >> 36 & 0xFFF, -ranges.speed_rad_s, ranges.speed_rad_s, 12),
        _value(word >> 24 & 0xFFF, 0.0, GAIN_Nm_PER_RAD, 12),
        _value(word >> 12 & 0xFFF, 0.0, GAIN_Nm_S_PER_RAD, 12),
        _value(word & 0xFFF, -ranges.torque_Nm, ranges.torque_Nm, 12),
    )


def encode_reply(ranges: MitRanges, reply: MitReply) -> bytes:
    """Encode a reply as the firmware does: codes are truncated, not rounded; speed and torque are
    clipped to their ranges.

    The position is `position_code`; temperature and error are sent where the reply has them. Raises
    NotEncodable for a number that does not fit its byte.
    """
    v = _truncate(reply.speed_rad_s, ranges.speed_rad_s)
    t = _truncate(reply.torque_Nm, ranges.torque_Nm)
    try:
        head = bytes([reply.drive_id]) + (reply.position_code << 24 | v << 12 | t).to_bytes(
            5, "big"
        )
        if reply.temperature_degC is None or reply.error is None:
            return head
        return head + bytes([reply.temperature_degC + ranges.temperature_offset_degC, reply.error])
    except (ValueError, OverflowError) as error:
        raise NotEncodable(f"MIT reply cannot carry {reply}: {error}") from error


def decode_reply(ranges: MitRanges, data: bytes | bytearray) -> MitReply:
    """Decode a reply. Raises MalformedFrame unless it has 6, 7 or 8 bytes."""
    if len(data) not in REPLY_LENGTHS:
        raise MalformedFrame(
            f"MIT reply of {len(data)} bytes, expected 6, 7 or 8; does the drive speak MIT mode?"
        )
    code = data[1] << 8 | data[2]
    temperature_degC = None
    error = None
    if len(data) == 8:
        temperature_degC = data[6] - ranges.temperature_offset_degC
        error = data[7]
    return MitReply(
        drive_id=data[0],
        position_code=code,
        position_rad=position_of(ranges, code),
        speed_rad_s=_value(
            data[3] << 4 | data[4] >> 4, -ranges.speed_rad_s, ranges.speed_rad_s, 12
        ),
        torque_Nm=_value((data[4] & 0xF) << 8 | data[5], -ranges.torque_Nm, ranges.torque_Nm, 12),
        temperature_degC=temperature_degC,
        error=error,
    )


def position_of(ranges: MitRanges, code: int) -> float:
    """The position in rad of a code; codes beyond 16 bits are allowed, for counted turns."""
    return _value(code, -ranges.position_rad, ranges.position_rad, 16)


def position_code(ranges: MitRanges, position_rad: float) -> int:
    """The code of a position in rad, truncated as in the firmware and not limited to 16 bits."""
    return floor(
        (position_rad + ranges.position_rad) * (POSITION_CODES - 1) / (2.0 * ranges.position_rad)
    )


def nearest_speed(ranges: MitRanges, speed_rad_s: float) -> float:
    """The nearest speed that a command can carry. Raises NotEncodable outside the range."""
    limit = ranges.speed_rad_s
    return _value(_code(speed_rad_s, -limit, limit, 12, "speed in rad/s"), -limit, limit, 12)


def _pack(p: int, v: int, kp: int, kd: int, t: int) -> bytes:
    return (p << 48 | v << 36 | kp << 24 | kd << 12 | t).to_bytes(8, "big")


def _code(value: float, low: float, high: float, bits: int, name: str) -> int:
    if not low <= value <= high:
        raise NotEncodable(
            f"{name} {value:g} does not fit its MIT field, limits {low:g} and {high:g}"
        )
    return round((value - low) * ((1 << bits) - 1) / (high - low))


def _truncate(value: float, limit: float) -> int:
    return floor((min(max(value, -limit), limit) + limit) * 4095 / (2.0 * limit))


def _value(code: int, low: float, high: float, bits: int) -> float:
    return low + code * (high - low) / ((1 << bits) - 1)
