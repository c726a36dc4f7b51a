"""moteus multiplex frames on CAN-FD, both directions, and the registers that are used here, with
the scales of their values; pure.

Sources: moteus reference, "CAN Protocol" and "Register Usage"; mjlib, multiplex/format.h ("Tunneled
Stream"). Little-endian throughout. A frame is a sequence of subframes. Those of registers have a
type byte, a count (in the type's two low bits, or a varuint where these are zero), the first
register, and for writes and replies the values. The frame is padded with NOP to the next length
that CAN-FD has. Values are in the register's physical unit, see `units_per_count`: revolutions of
the output, N m, A, V, degrees Celsius, seconds. The other subframes carry a stream of bytes both
ways, which the drive sends only when it is polled.
"""

import struct
from collections.abc import Sequence
from dataclasses import dataclass
from enum import IntEnum
from itertools import pairwise
from math import isfinite, isnan, nan

from rfca_rig.codecs.fdcanusb import FD_LENGTHS
from rfca_rig.errors import MalformedFrame, NotEncodable

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
    33: (
        "motor driver fault",
        "mostly the supply sagged under the current drawn; see the drv8323 diagnostics",
    ),
    34: (
        "over voltage",
        "supply above servo.max_voltage; check its setting, and where braking power goes",
    ),
    35: ("encoder fault", "the encoder's readings do not fit a magnet in place"),
    36: ("motor not configured", "run moteus_tool --calibrate on this motor"),
    37: ("pwm cycle overrun", "an internal error of the firmware"),
    38: ("over temperature", "board or motor above its limit; let it cool"),
    39: (
        "outside limit",
        "started outside servopos.position_min .. position_max; both must be nan for a leg that "
        "turns",
    ),
    40: ("under voltage", "supply too low; check the power supply"),
    41: ("config changed", "a setting was changed that needs a stop first"),
    42: ("theta invalid", "no valid encoder for commutation"),
    43: ("position invalid", "no valid encoder of the output"),
    44: ("driver enable fault", "the gate driver could not be switched on"),
    45: (
        "stop position deprecated",
        "a stop position was given together with velocity or acceleration limits",
    ),
    46: ("timing violation", "the firmware broke a time limit of its own"),
    47: (
        "bemf feedforward no accel",
        "servo.bemf_feedforward is set without an acceleration limit",
    ),
    48: ("invalid limits", "servopos.position_min or position_max lie outside the range available"),
}

# Codes in the fault register that are no faults: a function that limits the output while the drive
# runs.
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
    """Values of the register MODE; 2..4 are transitions to a mode in which the motor is
    controlled.
    """

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
    """Size of one count where the register holds a physical quantity; None for a plain whole
    number, and for a float.
    """
    scale = _SCALED.get(register)
    if scale is None or width == Width.FLOAT:
        return None
    return scale[width]


def name_of(register: int) -> str:
    """Name of a register for messages, or its number where it is not known here."""
    if register in set(Register):
        return Register(register).name
    return f"register 0x{register:03x}"


def mode_text(mode: int) -> str:
    return MODES.get(mode, f"mode {mode}")


def fault_text(code: int) -> str:
    """The code of register 0x00f with its name and meaning; codes of limiting functions are
    described as limits.
    """
    if code in LIMITS:
        return f"limit {code} (output limited by {LIMITS[code]})"
    name, meaning = FAULTS.get(code, ("not documented", "see the firmware's release notes"))
    return f"fault {code} ({name}: {meaning})"


def register_error_text(code: int) -> str:
    return REGISTER_ERRORS.get(code, f"error {code}")


MAX_FRAME_BYTES = FD_LENGTHS[-1]
LARGEST_ID = 0x7F
LARGEST_PREFIX = 0x1FFF

# Subframe types; the width is in bits 2 and 3 of the first three, the count in bits 0 and 1.
_WRITE = 0x00
_READ = 0x10
_REPLY = 0x20
_WRITE_ERROR = 0x30
_READ_ERROR = 0x31
_CLIENT_DATA = 0x40
_SERVER_DATA = 0x41
_CLIENT_POLL = 0x42
_NOP = 0x50
_FORMS = {
    width: struct.Struct(form) for width, form in zip(Width, ("<b", "<h", "<i", "<f"), strict=True)
}


@dataclass(frozen=True, slots=True)
class Write:
    """Sets a register to a value."""

    register: int
    width: Width
    value: float


@dataclass(frozen=True, slots=True)
class Read:
    """Asks for the value of a register."""

    register: int
    width: Width


@dataclass(frozen=True, slots=True)
class Reply:
    """The value of a register; NaN where the drive has no such value."""

    register: int
    width: Width
    value: float


@dataclass(frozen=True, slots=True)
class Refusal:
    """An error of the drive in writing (`of_write`) or reading a register."""

    register: int
    code: int
    of_write: bool


@dataclass(frozen=True, slots=True)
class ClientStreamData:
    """Bytes to the drive on a channel of its stream."""

    channel: int
    data: bytes


@dataclass(frozen=True, slots=True)
class ServerStreamData:
    """Bytes from the drive on a channel of its stream; none where it has nothing to say."""

    channel: int
    data: bytes


@dataclass(frozen=True, slots=True)
class StreamPoll:
    """Asks for the bytes that the drive has on a channel, `max_bytes` at most."""

    channel: int
    max_bytes: int


# Type, channel and length, in one byte each.
MAX_STREAM_BYTES = MAX_FRAME_BYTES - 3

StreamSubframe = ClientStreamData | ServerStreamData | StreamPoll
Subframe = Write | Read | Reply | Refusal | StreamSubframe


@dataclass(frozen=True, slots=True)
class Route:
    """Sender and receiver of a frame. `wants_reply` is set in requests; a drive answers from its
    own id to the sender's.
    """

    source: int
    destination: int
    wants_reply: bool = False
    prefix: int = 0


def arbitration_id(route: Route) -> int:
    """The arbitration id of a route, an extended one above 0x7ff. Raises NotEncodable for ids
    that do not exist.
    """
    for what, value, limit in (
        ("source", route.source, LARGEST_ID),
        ("destination", route.destination, LARGEST_ID),
    ):
        if not 0 <= value <= limit:
            raise NotEncodable(f"moteus {what} id {value} does not exist; ids go from 0 to {limit}")
    if not 0 <= route.prefix <= LARGEST_PREFIX:
        raise NotEncodable(
            f"moteus CAN prefix {route.prefix} does not exist; prefixes go from 0 to "
            f"{LARGEST_PREFIX}"
        )
    return route.prefix << 16 | route.wants_reply << 15 | route.source << 8 | route.destination


def route_of(identifier: int) -> Route:
    """The route in an arbitration id of up to 29 bits. The destination has eight bits here,
    though ids have seven.
    """
    return Route(
        identifier >> 8 & 0x7F, identifier & 0xFF, bool(identifier & 0x8000), identifier >> 16
    )


def encode(subframes: Sequence[Subframe]) -> bytes:
    """The data of a frame. Consecutive registers of one kind and width share a header. Raises
    NotEncodable where they do not fit.
    """
    cuts = [
        0,
        *(
            at
            for at, (subframe, next_one) in enumerate(pairwise(subframes), 1)
            if not _can_join(subframe, next_one)
        ),
        len(subframes),
    ]
    data = b"".join(_run(subframes[first:last]) for first, last in pairwise(cuts) if last > first)
    if len(data) > MAX_FRAME_BYTES:
        raise NotEncodable(
            f"moteus frame of {len(data)} bytes; CAN-FD carries {MAX_FRAME_BYTES}, ask "
            "for fewer registers at once"
        )
    length = next(length for length in FD_LENGTHS if length >= len(data))
    return data.ljust(length, bytes([_NOP]))


def _can_join(subframe: Subframe, next_one: Subframe) -> bool:
    alone = Refusal | StreamSubframe
    if isinstance(subframe, alone) or isinstance(next_one, alone):
        return False
    return (
        type(subframe) is type(next_one)
        and subframe.width == next_one.width
        and next_one.register == subframe.register + 1
    )


def _run(run: Sequence[Subframe]) -> bytes:
    first = run[0]
    if isinstance(first, Refusal):
        kind = _READ_ERROR
        if first.of_write:
            kind = _WRITE_ERROR
        return bytes([kind]) + _varuint(first.register) + _varuint(first.code)
    if isinstance(first, StreamSubframe):
        return _encode_stream(first)
    base = {Write: _WRITE, Read: _READ, Reply: _REPLY}[type(first)] | first.width << 2
    # Counts up to three fit into the type byte.
    if len(run) <= 3:
        head = bytes([base | len(run)])
    else:
        head = bytes([base]) + _varuint(len(run))
    values = (
        _pack(item.register, item.width, item.value)
        for item in run
        if isinstance(item, Write | Reply)
    )
    return head + _varuint(first.register) + b"".join(values)


def _encode_stream(subframe: StreamSubframe) -> bytes:
    if isinstance(subframe, StreamPoll):
        return bytes([_CLIENT_POLL]) + _varuint(subframe.channel) + _varuint(subframe.max_bytes)
    kind = _SERVER_DATA
    if isinstance(subframe, ClientStreamData):
        kind = _CLIENT_DATA
    head = bytes([kind]) + _varuint(subframe.channel) + _varuint(len(subframe.data))
    return head + subframe.data


def _pack(register: int, width: Width, value: float) -> bytes:
    try:
        if width != Width.FLOAT:
            value = _count(register, width, value)
        return _FORMS[width].pack(value)
    except (struct.error, OverflowError) as error:
        raise NotEncodable(
            f"moteus {name_of(register)} cannot carry {value:g} as {width.name}: {error}"
        ) from error


def _count(register: int, width: Width, value: float) -> int:
    """The count for a value. Raises NotEncodable where the register cannot carry it at this
    width.
    """
    # The lowest count means NaN, so quantities have one negative count less.
    unit = units_per_count(register, width)
    lowest = -(1 << (8 << width) - 1)
    if unit is None:
        if not (isfinite(value) and value == int(value)):
            raise NotEncodable(f"moteus {name_of(register)} holds whole numbers, not {value:g}")
        return int(value)
    if isnan(value):
        return lowest
    count = lowest
    if isfinite(value):
        count = round(value / unit)
    if not -lowest > count > lowest:
        limit = -(lowest + 1) * unit
        raise NotEncodable(
            f"moteus {name_of(register)} cannot carry {value:g} as {width.name}, limit "
            f"{limit:g}; use a wider register"
        )
    return count


def clip_to_register(register: int, width: Width, value: float) -> float:
    """The value that the register can carry, limited as in the firmware: NaN for values that are
    not finite, else clipped to the range.
    """
    unit = units_per_count(register, width)
    if width == Width.FLOAT or (unit is not None and not isfinite(value)):
        if width == Width.FLOAT:
            return value
        return nan
    highest = (1 << (8 << width) - 1) - 1
    limit = highest * (unit or 1.0)
    return min(max(value, -limit), limit)


def _varuint(value: int) -> bytes:
    # Seven bits per byte, the lowest first; the top bit says that more follow.
    out = bytearray()
    while value > 0x7F:
        out.append(value & 0x7F | 0x80)
        value >>= 7
    return bytes([*out, value])


def decode(data: bytes | bytearray) -> list[Subframe]:
    """The subframes in one frame, without padding. Raises MalformedFrame for data that the
    reference does not describe.
    """
    if len(data) not in FD_LENGTHS:
        raise MalformedFrame(f"moteus frame of {len(data)} bytes, which CAN-FD does not have")
    reader = _Reader(bytes(data))
    subframes: list[Subframe] = []
    while reader.left:
        subframes += _subframes(reader)
    return subframes


def _subframes(reader: "_Reader") -> list[Subframe]:
    kind = reader.byte()
    if kind == _NOP:
        return []
    if kind in {_WRITE_ERROR, _READ_ERROR}:
        return [Refusal(reader.varuint(), reader.varuint(), kind == _WRITE_ERROR)]
    if kind == _CLIENT_POLL:
        return [StreamPoll(reader.varuint(), reader.varuint())]
    if kind == _CLIENT_DATA:
        return [ClientStreamData(reader.varuint(), reader.take(reader.varuint()))]
    if kind == _SERVER_DATA:
        return [ServerStreamData(reader.varuint(), reader.take(reader.varuint()))]
    base = kind & 0xF0
    width = Width(kind >> 2 & 3)
    if base not in {_WRITE, _READ, _REPLY}:
        raise MalformedFrame(
            f"moteus subframe 0x{kind:02x} is neither write, read, reply, error, stream nor NOP"
        )
    return _registers(reader, base, width, kind & 3 or reader.varuint())


def _registers(reader: "_Reader", base: int, width: Width, count: int) -> list[Subframe]:
    first = 0
    if count:
        first = reader.varuint()
    # Before the loop: a damaged count could otherwise ask for billions of registers.
    if count > MAX_FRAME_BYTES:
        raise MalformedFrame(
            f"moteus subframe speaks of {count} registers; no frame can carry them"
        )
    if base == _READ:
        return [Read(register, width) for register in range(first, first + count)]
    kind = Write if base == _WRITE else Reply
    return [
        kind(register, width, _value(register, width, reader.number(width)))
        for register in range(first, first + count)
    ]


def _value(register: int, width: Width, number: float) -> float:
    unit = units_per_count(register, width)
    if unit is None:
        return number
    if number == -(1 << (8 << width) - 1):
        return nan
    return number * unit


class _Reader:
    """Reads numbers from the front of a frame. Raises MalformedFrame where the frame is too
    short.
    """

    def __init__(self, data: bytes) -> None:
        self._data = data
        self._at = 0

    @property
    def left(self) -> int:
        return len(self._data) - self._at

    def byte(self) -> int:
        self._need(1)
        self._at += 1
        return self._data[self._at - 1]

    def take(self, count: int) -> bytes:
        self._need(count)
        self._at += count
        return self._data[self._at - count : self._at]

    def varuint(self) -> int:
        value = 0
        # 32 bits take five bytes at most.
        for shift in range(0, 35, 7):
            byte = self.byte()
            value |= (byte & 0x7F) << shift
            if byte < 0x80:
                break
        else:
            raise MalformedFrame("moteus varuint of more than five bytes")
        if value > 0xFFFFFFFF:
            raise MalformedFrame("moteus varuint beyond 32 bits")
        return value

    def number(self, width: Width) -> float:
        form = _FORMS[width]
        self._need(form.size)
        self._at += form.size
        value: float = form.unpack_from(self._data, self._at - form.size)[0]
        return value

    def _need(self, size: int) -> None:
        if self.left < size:
            raise MalformedFrame(
                f"moteus frame ends {size - self.left} bytes too early: {self._data.hex(' ')}"
            )
