"""ATI Net F/T: requests and records by UDP (RDT), its configuration page, and its command interface
on TCP; pure.

RDT: ATI manual 9620-05-net ft, section 10. Big-endian, no padding. A record is 36 bytes; a datagram
holds 1..40 of them. Names of the page's elements: the chapter on the CGI interface. Of about
seventy these are the ones that are needed to interpret a stream.
"""

import struct
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from enum import IntEnum
from math import isfinite
from xml.etree import ElementTree as Xml

import numpy as np
from numpy.typing import NDArray

from rfca_rig.codecs.force_sensors import (
    force_code,
    force_unit,
    newton_metres_per,
    newtons_per,
    torque_code,
    torque_unit,
)
from rfca_rig.errors import MalformedFrame, NotEncodable

PORT = 49152
RECORD_BYTES = 36
MAX_RECORDS = 40
HEADER = 0x1234

_REQUEST = struct.Struct(">HHI")

PATH = "/netftapi2.xml"
# A larger page is not parsed.
MAX_PAGE_BYTES = 1 << 16

# Units of the tool transformation. A box states "mm" and "degrees"; the other names are guesses
# after the manual's units, none was seen on a box.
MM_PER_UNIT = {"mm": 1.0, "cm": 10.0, "m": 1e3, "in": 25.4, "ft": 304.8}
DEG_PER_UNIT = {
    "degrees": 1.0,
    "deg": 1.0,
    "radians": float(np.degrees(1.0)),
    "rad": float(np.degrees(1.0)),
}
# The command interface keeps hundredths of a unit.
TRANSFORMATION_DIGITS = 0.005
# Cut-off frequencies of the codes of setuserfilter on a NetBox. Not verified, neither on a box nor
# in its manual. The codes of an Ethernet Axia depend on its sampling rate, and are not known here.
LOW_PASS_HZ = {
    "1": 838.0,
    "2": 326.0,
    "3": 152.0,
    "4": 73.0,
    "5": 35.0,
    "6": 18.0,
    "7": 8.0,
    "8": 5.0,
    "9": 1500.0,
    "10": 2000.0,
    "11": 2500.0,
    "12": 3000.0,
}

COMMAND_PORT = 49151
COMMAND_BYTES = 20

_READ_FORCE = 0
_READ_CALIBRATION = 1
_BIAS = 1
_CLEAR_LATCH = 2

_READING = struct.Struct(">HH6h")
_CALIBRATION = struct.Struct(">HBBII6H")

READING_BYTES = _READING.size
CALIBRATION_BYTES = _CALIBRATION.size


class RdtCommand(IntEnum):
    """Commands of a request. None of them is acknowledged."""

    STOP = 0x0000
    START_SINGLE = 0x0002
    START_BUFFERED = 0x0003
    RESET_LATCH = 0x0041
    SET_BIAS = 0x0042


def start_command(is_buffered: bool) -> RdtCommand:
    """The command that starts a stream of several records in a datagram, or of one."""
    if is_buffered:
        return RdtCommand.START_BUFFERED
    return RdtCommand.START_SINGLE


@dataclass(frozen=True, slots=True)
class Request:
    """A request of `sample_count` records; 0 is without end. `command` may be one that
    `RdtCommand` does not know.
    """

    command: int
    sample_count: int = 0


@dataclass(frozen=True)
class Records:
    """m records: both sequence counters and the status word (m,), and `counts` (m, 6) = fx fy fz
    tx ty tz.
    """

    rdt_sequence: NDArray[np.uint32]
    ft_sequence: NDArray[np.uint32]
    status: NDArray[np.uint32]
    counts: NDArray[np.int32]


def encode_request(command: int, sample_count: int = 0) -> bytes:
    """Encode a request. Raises NotEncodable where a number does not fit its field."""
    try:
        return _REQUEST.pack(HEADER, command, sample_count)
    except struct.error as error:
        raise NotEncodable(
            f"RDT request cannot carry command {command:#x} with {sample_count} records: {error}"
        ) from error


def decode_request(datagram: bytes) -> Request:
    """Decode a request. Raises MalformedFrame for a wrong length or header."""
    if len(datagram) != _REQUEST.size:
        raise MalformedFrame(f"RDT request of {len(datagram)} bytes, expected {_REQUEST.size}")
    header, command, sample_count = _REQUEST.unpack(datagram)
    if header != HEADER:
        raise MalformedFrame(f"RDT request begins with 0x{header:04x}, expected 0x{HEADER:04x}")
    return Request(command, sample_count)


def decode_records(datagram: bytes) -> Records:
    """All records of one datagram. Raises MalformedFrame unless it holds 1..40 whole ones."""
    count, rest = divmod(len(datagram), RECORD_BYTES)
    if rest or not 1 <= count <= MAX_RECORDS:
        raise MalformedFrame(
            f"RDT datagram of {len(datagram)} bytes, expected 1..{MAX_RECORDS} records of "
            f"{RECORD_BYTES} bytes"
        )
    # Read as unsigned words; the last six are signed, and the view keeps their bits.
    words = np.frombuffer(datagram, ">u4").reshape(count, 9).astype(np.uint32)
    return Records(words[:, 0], words[:, 1], words[:, 2], words[:, 3:].view(np.int32))


def encode_records(records: Records) -> bytes:
    """One datagram. Raises NotEncodable unless there are 1..40 records."""
    count = len(records.rdt_sequence)
    if not 1 <= count <= MAX_RECORDS:
        raise NotEncodable(f"{count} records do not fit one RDT datagram, limit 1..{MAX_RECORDS}")
    words = np.empty((count, 9), ">u4")
    words[:, 0] = records.rdt_sequence
    words[:, 1] = records.ft_sequence
    words[:, 2] = records.status
    words[:, 3:] = records.counts.view(np.uint32)
    return words.tobytes()


@dataclass(frozen=True)
class ToolTransformation:
    """Shift and turn of the frame in which the box states forces, from the transducer's own: the
    shift first, then the turns about x, y and z.

    This order is not verified on a box; the numbers are only compared.
    """

    shift_mm: tuple[float, ...] = (0.0,) * 3
    turn_deg: tuple[float, ...] = (0.0,) * 3

    @property
    def is_identity(self) -> bool:
        return self.is_close(NO_TRANSFORMATION)

    def is_close(self, other: "ToolTransformation") -> bool:
        """Whether both are the same to the digits of the page."""
        return bool(
            np.allclose(self.shift_mm, other.shift_mm, rtol=0.0, atol=TRANSFORMATION_DIGITS)
            and np.allclose(self.turn_deg, other.turn_deg, rtol=0.0, atol=TRANSFORMATION_DIGITS)
        )

    def __str__(self) -> str:
        if self.is_identity:
            return "none"
        shift = ", ".join(f"{value:g}" for value in self.shift_mm)
        turn = ", ".join(f"{value:g}" for value in self.turn_deg)
        return f"shift {shift} mm, turn {turn} degrees"


NO_TRANSFORMATION = ToolTransformation()


@dataclass(frozen=True)
class NetFtConfiguration:
    """Configuration of the box. None where an element is not on its page, as on other models and
    firmware.

    `rdt_rate_Hz` is the requested rate; the actual one follows from `decimation`. `low_pass` is the
    code of its filter, "0" for none. `is_axia`: the page is that of an Ethernet Axia, whose status
    bits are others.
    """

    product: str
    serial_number: str
    force_unit: str
    torque_unit: str
    counts_per_force: float
    counts_per_torque: float
    rdt_enabled: bool | None = None
    rdt_rate_Hz: float | None = None
    internal_rate_Hz: float | None = None
    records_per_datagram: int | None = None
    low_pass: str | None = None
    tool_transformation: ToolTransformation | None = None
    is_axia: bool = False

    @property
    def counts_per_N(self) -> float:
        return self.counts_per_force / newtons_per(self.force_unit)

    @property
    def counts_per_Nm(self) -> float:
        return self.counts_per_torque / newton_metres_per(self.torque_unit)

    def decimation(self, internal_rate_Hz: float) -> int | None:
        """Internal samples per record: the box rounds the rate up to the next possible one. None
        where the page states no rate.
        """
        # 1e-6 against rounding of an exact ratio, 1e9 against overflow of a tiny rate.
        if self.rdt_rate_Hz is None:
            return None
        return max(1, int(min(internal_rate_Hz / self.rdt_rate_Hz, 1e9) + 1e-6))


def decode_configuration(page: bytes) -> NetFtConfiguration:
    """Decode the configuration page. Raises MalformedFrame for a page that is not the box's XML,
    or lacks units or counts.
    """
    values = _values(page)
    records_per_datagram = None
    if "comrdtbsiz" in values:
        records_per_datagram = int(_positive(values, "comrdtbsiz"))
    return NetFtConfiguration(
        product=_require(values, "prodname"),
        serial_number=values.get("cfgcalsn", ""),
        force_unit=_unit(values, "scfgfu", newtons_per),
        torque_unit=_unit(values, "scfgtu", newton_metres_per),
        counts_per_force=_positive(values, "cfgcpf"),
        counts_per_torque=_positive(values, "cfgcpt"),
        rdt_enabled=_is_enabled(values, "comrdte"),
        rdt_rate_Hz=_positive_or_none(values, "comrdtrate"),
        internal_rate_Hz=_positive_or_none(values, "runrate"),
        records_per_datagram=records_per_datagram,
        low_pass=values.get("setuserfilter"),
        tool_transformation=_transformation(values),
        is_axia="axia" in values["prodname"].lower() or "setiirshift" in values,
    )


def encode_configuration(configuration: NetFtConfiguration, others: Mapping[str, str]) -> bytes:
    """The page of a configuration, with `others` as additional elements."""
    root = Xml.Element("netft")
    for name, value in {**_elements(configuration), **others}.items():
        Xml.SubElement(root, name).text = value
    return bytes(Xml.tostring(root, encoding="utf-8", xml_declaration=True))


def _elements(configuration: NetFtConfiguration) -> dict[str, str]:
    rdt_state = {None: None, True: "Enabled", False: "Disabled"}
    known = {
        "prodname": configuration.product,
        "cfgcalsn": configuration.serial_number,
        "scfgfu": configuration.force_unit,
        "scfgtu": configuration.torque_unit,
        "cfgcpf": f"{configuration.counts_per_force:.10g}",
        "cfgcpt": f"{configuration.counts_per_torque:.10g}",
        "comrdte": rdt_state[configuration.rdt_enabled],
        "comrdtrate": _number_text(configuration.rdt_rate_Hz),
        "runrate": _number_text(configuration.internal_rate_Hz),
        "comrdtbsiz": _number_text(configuration.records_per_datagram),
        "setuserfilter": configuration.low_pass,
        **_transformation_elements(configuration.tool_transformation),
    }
    return {name: value for name, value in known.items() if value is not None}


def _number_text(value: float | None) -> str | None:
    if value is None:
        return None
    return f"{value:.10g}"


def _values(page: bytes) -> dict[str, str]:
    # A document type could define entities that expand without limit.
    if len(page) > MAX_PAGE_BYTES or b"<!DOCTYPE" in page:
        raise MalformedFrame(f"page of {len(page)} bytes is no configuration page of a Net F/T")
    try:
        root = Xml.fromstring(page)
    except (Xml.ParseError, ValueError, LookupError) as error:
        raise MalformedFrame(f"configuration page is not XML: {error}") from None
    if root.tag != "netft":
        raise MalformedFrame(f"configuration page begins with <{root.tag[:40]}>, expected <netft>")
    return {child.tag: (child.text or "").strip() for child in root}


def _require(values: Mapping[str, str], name: str) -> str:
    if not values.get(name):
        raise MalformedFrame(f"configuration page lacks {name}")
    return values[name]


def _unit(values: Mapping[str, str], name: str, size: Callable[[str], float]) -> str:
    unit = _require(values, name)
    # Raises for an unknown unit here, where the page is read, and not at the first force.
    size(unit)
    return unit


def _positive(values: Mapping[str, str], name: str) -> float:
    text = _require(values, name)
    try:
        value = float(text)
    except ValueError:
        value = float("nan")
    if not isfinite(value) or value <= 0.0:
        raise MalformedFrame(
            f"configuration page: {name} is {text[:40]!r}, must be a number above 0"
        )
    return value


def _positive_or_none(values: Mapping[str, str], name: str) -> float | None:
    if name not in values:
        return None
    return _positive(values, name)


def _transformation(values: Mapping[str, str]) -> ToolTransformation | None:
    if "cfgtfx" not in values:
        return None
    text = values["cfgtfx"]
    try:
        numbers = [float(part) for part in text.strip(";").split(";")]
    except ValueError:
        numbers = []
    if len(numbers) != 6 or not all(map(isfinite, numbers)):
        raise MalformedFrame(
            f"configuration page: cfgtfx is {text[:60]!r}, must be six numbers with ; between them"
        )
    # Without a transformation the units mean nothing.
    if not any(numbers):
        return NO_TRANSFORMATION
    mm = _size_of_unit(values, "scfgtdu", MM_PER_UNIT)
    deg = _size_of_unit(values, "scfgtau", DEG_PER_UNIT)
    return ToolTransformation(
        tuple(mm * number for number in numbers[:3]), tuple(deg * number for number in numbers[3:])
    )


def _size_of_unit(values: Mapping[str, str], name: str, sizes: Mapping[str, float]) -> float:
    unit = _require(values, name)
    if unit not in sizes:
        raise MalformedFrame(
            f"configuration page: {name} is {unit[:40]!r}, known are {', '.join(sizes)}"
        )
    return sizes[unit]


def _transformation_elements(transformation: ToolTransformation | None) -> dict[str, str]:
    if transformation is None:
        return {}
    numbers = (*transformation.shift_mm, *transformation.turn_deg)
    return {
        "cfgtfx": ";".join(f"{number:.10g}" for number in numbers),
        "scfgtdu": "mm",
        "scfgtau": "degrees",
    }


def _is_enabled(values: Mapping[str, str], name: str) -> bool | None:
    text = values.get(name)
    if text is not None and text not in {"Enabled", "Disabled"}:
        raise MalformedFrame(
            f"configuration page: {name} is {text[:40]!r}, expected Enabled or Disabled"
        )
    if text is None:
        return None
    return text == "Enabled"


def describe_low_pass(code: str, is_axia: bool) -> str:
    """The box's filter in words."""
    if code == "0":
        return "off"
    cut_off_Hz = LOW_PASS_HZ.get(code)
    if is_axia or cut_off_Hz is None:
        return f"on, code {code}, cut-off not known here: see the box's Settings page"
    return f"on, code {code}, about {cut_off_Hz:g} Hz (not verified)"


def lag_of_low_pass_s(code: str, is_axia: bool) -> float | None:
    """Time constant of a first-order low-pass with that cut-off; None where it is not known."""
    if is_axia or code not in LOW_PASS_HZ:
        return None
    return 1.0 / (2.0 * np.pi * LOW_PASS_HZ[code])


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
    """One reading. `status` is the upper half of the status word; a value is counts * scale
    factor / counts per unit.
    """

    status: int
    counts: tuple[int, ...]


@dataclass(frozen=True, slots=True)
class CalibrationInfo:
    """Units and scales. The six `scale_factors` reduce the counts of a `NetFtReading` to 16
    bits; they do not act on RDT.
    """

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
    """Decode a command. Raises MalformedFrame for a wrong length, and for a command other than
    the two that read.
    """
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
    """Encode calibration info. Raises NotEncodable where a unit has no code or a number does not
    fit its field.
    """
    try:
        codes = force_code(info.force_unit), torque_code(info.torque_unit)
        return _CALIBRATION.pack(
            HEADER, *codes, info.counts_per_force, info.counts_per_torque, *info.scale_factors
        )
    except (struct.error, ValueError) as error:
        raise NotEncodable(f"{info} does not fit: {error}") from error


def decode_calibration(data: bytes) -> CalibrationInfo:
    """Decode calibration info. Raises MalformedFrame for a wrong length or header, an unknown
    unit, or counts per unit of 0.
    """
    header, force, torque, counts_per_force, counts_per_torque, *factors = _unpack(
        _CALIBRATION, data, "calibration info"
    )
    _check_header(header)
    # Every later conversion divides by these.
    if not counts_per_force or not counts_per_torque:
        raise MalformedFrame(
            f"calibration info with {counts_per_force} counts per force, "
            f"{counts_per_torque} per torque, must be above 0"
        )
    return CalibrationInfo(
        force_unit(force), torque_unit(torque), counts_per_force, counts_per_torque, tuple(factors)
    )


def _unpack(layout: struct.Struct, data: bytes, what: str) -> tuple[int, ...]:
    if len(data) != layout.size:
        raise MalformedFrame(f"{what} of {len(data)} bytes, expected {layout.size}")
    return layout.unpack(data)


def _check_header(header: int) -> None:
    if header != HEADER:
        raise MalformedFrame(f"reply begins with 0x{header:04x}, expected 0x{HEADER:04x}")
