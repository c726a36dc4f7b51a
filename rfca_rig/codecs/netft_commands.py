"""ATI Net F/T command interface (TCP port 49151): one reading, calibration info; pure.

Layout: ATI manual 9620-05-net ft, section 11. Commands of 20 bytes, replies that begin with 0x1234, big-endian.
"""

import struct
from dataclasses import dataclass

from rfca_rig.codecs.ati_units import force_code, force_unit, newton_metres_per, newtons_per, torque_code, torque_unit
from rfca_rig.codecs.malformed import MalformedFrame, NotEncodable

PORT = 49151
COMMAND_BYTES = 20
HEADER = 0x1234

_READ_FORCE, _READ_CALIBRATION = 0, 1
_BIAS, _CLEAR_LATCH = 1, 2

_READING = struct.Struct(">HH6h")
_CALIBRATION = struct.Struct(">HBBII6H")

READING_BYTES = _READING.size
CALIBRATION_BYTES = _CALIBRATION.size


@dataclass(frozen=True, slots=True)
class ReadForce:
    """Request of one reading; `bias` and `clear_latch` are carried out with it."""

    bias: bool = False
    clear_latch: bool = False


@dataclass(frozen=True, slots=True)
class ReadCalibrationInfo:
    """Request of units, counts per unit and scale factors."""


@dataclass(frozen=True, slots=True)
class NetFtReading:
    """One reading. `status` is the upper half of the status word; a value is counts * scale factor / counts per unit."""

    status: int
    counts: tuple[int, ...]


@dataclass(frozen=True, slots=True)
class CalibrationInfo:
    """Units and scales. The six `scale_factors` reduce the counts of a `NetFtReading` to 16 bits; they do not act on RDT."""

    force_unit: str
    torque_unit: str
    counts_per_force: int
    counts_per_torque: int
    scale_factors: tuple[int, ...]

    @property
    def counts_per_N(self) -> float:
        return self.counts_per_force / newtons_per(self.force_unit)

    @property
    def counts_per_Nm(self) -> float:
        return self.counts_per_torque / newton_metres_per(self.torque_unit)


def encode_command(command: ReadForce | ReadCalibrationInfo) -> bytes:
    """The 20 bytes of a command."""
    if isinstance(command, ReadCalibrationInfo):
        return bytes([_READ_CALIBRATION]).ljust(COMMAND_BYTES, b"\0")
    orders = _BIAS * command.bias | _CLEAR_LATCH * command.clear_latch
    return bytes([_READ_FORCE]).ljust(COMMAND_BYTES - 2, b"\0") + orders.to_bytes(2)


def decode_command(data: bytes) -> ReadForce | ReadCalibrationInfo:
    """Decode a command. Raises MalformedFrame for a wrong length, and for a command other than the two that read."""
    if len(data) != COMMAND_BYTES:
        raise MalformedFrame(f"command of {len(data)} bytes, expected {COMMAND_BYTES}")
    if data[0] == _READ_CALIBRATION:
        return ReadCalibrationInfo()
    if data[0] == _READ_FORCE:
        return ReadForce(bool(data[-1] & _BIAS), bool(data[-1] & _CLEAR_LATCH))
    raise MalformedFrame(f"command {data[0]} is not one of those that read (0, 1)")


def encode_reading(reading: NetFtReading) -> bytes:
    """Encode a reading. Raises NotEncodable where a count does not fit 16 bits."""
    try:
        return _READING.pack(HEADER, reading.status, *reading.counts)
    except struct.error as error:
        raise NotEncodable(f"{reading} does not fit: {error}") from error


def decode_reading(data: bytes) -> NetFtReading:
    """Decode a reading. Raises MalformedFrame for a wrong length or header."""
    header, status, *counts = _unpack(_READING, data, "reading")
    _check_header(header)
    return NetFtReading(status, tuple(counts))


def encode_calibration(info: CalibrationInfo) -> bytes:
    """Encode calibration info. Raises NotEncodable where a unit has no code or a number does not fit its field."""
    try:
        codes = force_code(info.force_unit), torque_code(info.torque_unit)
        return _CALIBRATION.pack(HEADER, *codes, info.counts_per_force, info.counts_per_torque, *info.scale_factors)
    except (struct.error, ValueError) as error:
        raise NotEncodable(f"{info} does not fit: {error}") from error


def decode_calibration(data: bytes) -> CalibrationInfo:
    """Decode calibration info. Raises MalformedFrame for a wrong length or header, an unknown unit, or counts per unit of 0."""
    header, force, torque, counts_per_force, counts_per_torque, *factors = _unpack(_CALIBRATION, data, "calibration info")
    _check_header(header)
    # Every later conversion divides by these.
    if not counts_per_force or not counts_per_torque:
        raise MalformedFrame(f"calibration info with {counts_per_force} counts per force, {counts_per_torque} per torque, must be above 0")
    return CalibrationInfo(force_unit(force), torque_unit(torque), counts_per_force, counts_per_torque, tuple(factors))


def _unpack(layout: struct.Struct, data: bytes, what: str) -> tuple[int, ...]:
    if len(data) != layout.size:
        raise MalformedFrame(f"{what} of {len(data)} bytes, expected {layout.size}")
    return layout.unpack(data)


def _check_header(header: int) -> None:
    if header != HEADER:
        raise MalformedFrame(f"reply begins with 0x{header:04x}, expected 0x{HEADER:04x}")
