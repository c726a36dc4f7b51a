"""ATI Net F/T Raw Data Transfer (RDT): requests and records over UDP; pure.

Layout: ATI manual 9620-05-net ft, section 10. Big-endian, no padding. A record is 36 bytes; a datagram holds 1..40 of them.
"""

import struct
from dataclasses import dataclass
from enum import IntEnum

import numpy as np
from numpy.typing import NDArray

from rfca_rig.errors import MalformedFrame, NotEncodable

PORT = 49152
RECORD_BYTES = 36
MAX_RECORDS = 40
HEADER = 0x1234

_REQUEST = struct.Struct(">HHI")

STATUS_BITS = {
    31: "error, see the other bits",
    30: "CPU or RAM",
    29: "digital board",
    28: "analog board",
    27: "serial link",
    26: "program memory",
    25: "halted by its configuration",
    24: "settings",
    23: "configuration does not match the calibration",
    22: "network",
    21: "CAN",
    20: "RDT",
    19: "EtherNet/IP",
    18: "DeviceNet",
    17: "transducer saturation or A/D error",
    16: "monitor condition latched",
    14: "watchdog",
    13: "stack",
    12: "I2C EEPROM",
    11: "SPI flash",
    10: "analog watchdog",
    9: "excitation too high",
    8: "excitation too low",
    7: "artificial ground",
    6: "supply too high",
    5: "supply too low",
    4: "serial link data unavailable",
    3: "reference voltage",
    2: "temperature",
    1: "HTTP",
}

# Summary bit; the other bits give the reason.
ERROR = 1 << 31
SATURATED = ERROR | 1 << 17
MONITOR_LATCHED = 1 << 16
# Words with which the values are good: a latched monitor condition does not affect them.
WARNINGS = frozenset({0, MONITOR_LATCHED, ERROR | MONITOR_LATCHED})


class RdtCommand(IntEnum):
    """Commands of a request. None of them is acknowledged."""

    STOP = 0x0000
    START_SINGLE = 0x0002
    START_BUFFERED = 0x0003
    RESET_LATCH = 0x0041
    SET_BIAS = 0x0042


@dataclass(frozen=True, slots=True)
class Request:
    """A request of `sample_count` records; 0 is without end. `command` may be one that `RdtCommand` does not know."""

    command: int
    sample_count: int = 0


@dataclass(frozen=True)
class Records:
    """m records: both sequence counters and the status word (m,), and `counts` (m, 6) = fx fy fz tx ty tz."""

    rdt_sequence: NDArray[np.uint32]
    ft_sequence: NDArray[np.uint32]
    status: NDArray[np.uint32]
    counts: NDArray[np.int32]


def encode_request(command: int, sample_count: int = 0) -> bytes:
    """Encode a request. Raises NotEncodable where a number does not fit its field."""
    try:
        return _REQUEST.pack(HEADER, command, sample_count)
    except struct.error as error:
        raise NotEncodable(f"RDT request cannot carry command {command:#x} with {sample_count} records: {error}") from error


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
        raise MalformedFrame(f"RDT datagram of {len(datagram)} bytes, expected 1..{MAX_RECORDS} records of {RECORD_BYTES} bytes")
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


def status_text(word: int) -> str:
    """The status word in hexadecimal with the meaning of every bit that is set, except the summary bit."""
    bits = [bit for bit in range(30, -1, -1) if word >> bit & 1]
    meanings = [STATUS_BITS.get(bit, f"bit {bit}, not documented") for bit in bits] or [STATUS_BITS[31] if word else "healthy"]
    return f"status 0x{word:08x} ({'; '.join(meanings)})"
