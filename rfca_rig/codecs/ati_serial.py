"""ATI F/T Controller (CTL, CON) on RS-232: commands, and records in ASCII and binary; pure.

Commands end in a carriage return, are echoed, and are answered by a prompt. Commands: the controller's command list (ATI manual
9620-05-CTL). ASCII record: error flag and six counts, 45 characters with CR LF. Binary record: one byte of error flag and six 16 bit
counts, high byte first. With `CD E` a checksum follows. The documents do not define it; here it is the sum of the record's bytes modulo
256. If a controller computes it differently, every record is refused, and the driver reports it.
"""

import re
import struct
from dataclasses import dataclass
from enum import Enum

from rfca_rig.codecs.malformed import MalformedFrame, NotEncodable

END = b"\r"
PROMPT = b">"
LINE_END = b"\r\n"
ASCII_BYTES = 45
MAX_COUNT = 2**15 - 1

Counts = tuple[int, int, int, int, int, int]

_BINARY = struct.Struct(">B6h")
_ASCII = re.compile(rb" *([01])((?:, *-?[0-9]{1,5}){6})\r?\n?")


class RecordForm(Enum):
    """Format of the controller's records."""

    ASCII = "ascii"
    BINARY = "binary"
    BINARY_CHECKSUM = "binary-checksum"

    @property
    def record_bytes(self) -> int:
        """Length of one record on the wire."""
        sizes = {RecordForm.ASCII: ASCII_BYTES, RecordForm.BINARY: _BINARY.size, RecordForm.BINARY_CHECKSUM: _BINARY.size + 1}
        return sizes[self]


class AtiCommand(bytes, Enum):
    """Commands of the controller, without the carriage return. An empty command ends a stream."""

    NOTHING = b""
    ASCII = b"CD A"
    BINARY = b"CD B"
    CHECKSUM_ON = b"CD E"
    CHECKSUM_OFF = b"CD U"
    FORCES = b"CD R"
    LINE_FEEDS = b"CL 1"
    QUERY_RECORD = b"QR"
    QUERY_STREAM = b"QS"
    BIAS = b"SB"
    UNBIAS = b"SU"
    UNBIAS_ALL = b"SZ"


SETUP = {
    RecordForm.ASCII: (AtiCommand.FORCES, AtiCommand.LINE_FEEDS, AtiCommand.ASCII),
    RecordForm.BINARY: (AtiCommand.FORCES, AtiCommand.CHECKSUM_OFF, AtiCommand.BINARY),
    RecordForm.BINARY_CHECKSUM: (AtiCommand.FORCES, AtiCommand.CHECKSUM_ON, AtiCommand.BINARY),
}


@dataclass(frozen=True, slots=True)
class AtiRecord:
    """One record. `error` is 0 while the values are good; saturation or a disconnected transducer set it. Counts: fx fy fz tx ty tz."""

    error: int
    counts: Counts


def encode_command(command: bytes) -> bytes:
    """A command with its line end. Raises NotEncodable for a command that holds a carriage return or line feed."""
    # A line end inside would make the controller see two commands.
    if b"\r" in command or b"\n" in command:
        raise NotEncodable(f"command {command!r} holds a line end of its own")
    return bytes(command) + END


def encode_record(record: AtiRecord, form: RecordForm) -> bytes:
    """One record as the controller sends it. Raises NotEncodable for a count that 16 bits do not hold."""
    try:
        packed = _BINARY.pack(record.error, *record.counts)
    except struct.error as error:
        raise NotEncodable(f"record {record} does not fit: {error}") from error
    if form is RecordForm.ASCII:
        return b"%d" % record.error + b"".join(b",%6d" % count for count in record.counts) + LINE_END
    return packed + (checksum(packed) if form is RecordForm.BINARY_CHECKSUM else b"")


def decode_record(data: bytes, form: RecordForm) -> AtiRecord:
    """One record. Raises MalformedFrame for a wrong length, form, error flag or checksum."""
    return _decode_ascii(data) if form is RecordForm.ASCII else _decode_binary(data, form)


def _decode_ascii(line: bytes) -> AtiRecord:
    found = _ASCII.fullmatch(line)
    if found is None:
        raise MalformedFrame(f"line {line[:60]!r} is no record of an error flag and six counts")
    counts = [int(word) for word in found[2].split(b",")[1:]]
    if not all(-MAX_COUNT - 1 <= count <= MAX_COUNT for count in counts):
        raise MalformedFrame(f"line {line[:60]!r} holds a count beyond 16 bits")
    return AtiRecord(int(found[1]), (counts[0], counts[1], counts[2], counts[3], counts[4], counts[5]))


def _decode_binary(data: bytes, form: RecordForm) -> AtiRecord:
    if len(data) != form.record_bytes:
        raise MalformedFrame(f"binary record of {len(data)} bytes, expected {form.record_bytes}")
    if form is RecordForm.BINARY_CHECKSUM and checksum(data[:-1]) != data[-1:]:
        raise MalformedFrame(f"checksum of a binary record is 0x{data[-1]:02x}, its bytes add up to 0x{checksum(data[:-1])[0]:02x}")
    error, fx, fy, fz, tx, ty, tz = _BINARY.unpack(data[: _BINARY.size])
    # The flag is the only redundancy of a record without checksum: another value means that bytes are out of step.
    if error > 1:
        raise MalformedFrame(f"binary record begins with error flag 0x{error:02x}, expected 0 or 1")
    return AtiRecord(error, (fx, fy, fz, tx, ty, tz))


def checksum(record: bytes) -> bytes:
    """One byte: the sum of the record's bytes modulo 256."""
    return bytes([sum(record) & 0xFF])
