"""ATI F/T Controller (CTL, CON) on RS-232: commands, and records in ASCII and binary; pure.

Commands end in a carriage return, are echoed, and are answered by a prompt. Commands: the
controller's command list (ATI manual 9620-05-CTL). ASCII record: error flag and six counts, 45
characters with CR LF. Binary record: one byte of error flag and six 16 bit counts, high byte first.
With `CD E` a checksum follows. The documents do not define it; here it is the sum of the record's
bytes modulo
256. If a controller computes it differently, every record is refused, and the driver reports it.
"""

import itertools
import re
import struct
from dataclasses import dataclass
from enum import Enum
from typing import Protocol

from rfca_rig.errors import MalformedFrame, NotEncodable

END = b"\r"
PROMPT = b">"
LINE_END = b"\r\n"
ASCII_BYTES = 45
MAX_COUNT = 2**15 - 1

Counts = tuple[int, int, int, int, int, int]

_BINARY = struct.Struct(">B6h")
_ASCII = re.compile(rb" *([01])((?:, *-?[0-9]{1,5}){6})\r?\n?")

LONGEST_LINE = 200
# Number of consecutive records that must be valid before an alignment is accepted.
ALIGNED_RUN = 4
# Change of a count between records; a larger one is a sign of bytes that are out of step.
LARGEST_JUMP = 2**13


class RecordForm(Enum):
    """Format of the controller's records."""

    ASCII = "ascii"
    BINARY = "binary"
    BINARY_CHECKSUM = "binary-checksum"

    @property
    def record_bytes(self) -> int:
        """Length of one record on the wire."""
        sizes = {
            RecordForm.ASCII: ASCII_BYTES,
            RecordForm.BINARY: _BINARY.size,
            RecordForm.BINARY_CHECKSUM: _BINARY.size + 1,
        }
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
    """One record. `error` is 0 while the values are good; saturation or a disconnected
    transducer set it. Counts: fx fy fz tx ty tz.
    """

    error: int
    counts: Counts


def encode_command(command: bytes) -> bytes:
    """A command with its line end. Raises NotEncodable for a command that holds a carriage
    return or line feed.
    """
    # A line end inside would make the controller see two commands.
    if b"\r" in command or b"\n" in command:
        raise NotEncodable(f"command {command!r} holds a line end of its own")
    return bytes(command) + END


def encode_record(record: AtiRecord, form: RecordForm) -> bytes:
    """One record as the controller sends it. Raises NotEncodable for a count that 16 bits do not
    hold.
    """
    try:
        packed = _BINARY.pack(record.error, *record.counts)
    except struct.error as error:
        raise NotEncodable(f"record {record} does not fit: {error}") from error
    if form is RecordForm.ASCII:
        return (
            b"%d" % record.error + b"".join(b",%6d" % count for count in record.counts) + LINE_END
        )
    if form is RecordForm.BINARY_CHECKSUM:
        packed += checksum(packed)
    return packed


def decode_record(data: bytes, form: RecordForm) -> AtiRecord:
    """One record. Raises MalformedFrame for a wrong length, form, error flag or checksum."""
    if form is RecordForm.ASCII:
        return _decode_ascii(data)
    return _decode_binary(data, form)


def _decode_ascii(line: bytes) -> AtiRecord:
    match = _ASCII.fullmatch(line)
    if match is None:
        raise MalformedFrame(f"line {line[:60]!r} is no record of an error flag and six counts")
    counts = [int(word) for word in match[2].split(b",")[1:]]
    if not all(-MAX_COUNT - 1 <= count <= MAX_COUNT for count in counts):
        raise MalformedFrame(f"line {line[:60]!r} holds a count beyond 16 bits")
    return AtiRecord(
        int(match[1]), (counts[0], counts[1], counts[2], counts[3], counts[4], counts[5])
    )


def _decode_binary(data: bytes, form: RecordForm) -> AtiRecord:
    if len(data) != form.record_bytes:
        raise MalformedFrame(f"binary record of {len(data)} bytes, expected {form.record_bytes}")
    if form is RecordForm.BINARY_CHECKSUM and checksum(data[:-1]) != data[-1:]:
        raise MalformedFrame(
            f"checksum of a binary record is 0x{data[-1]:02x}, its bytes add up to "
            f"0x{checksum(data[:-1])[0]:02x}"
        )
    error, fx, fy, fz, tx, ty, tz = _BINARY.unpack(data[: _BINARY.size])
    # The flag is the only redundancy of a record without checksum: another value means that bytes
    # are out of step.
    if error > 1:
        raise MalformedFrame(f"binary record begins with error flag 0x{error:02x}, expected 0 or 1")
    return AtiRecord(error, (fx, fy, fz, tx, ty, tz))


def checksum(record: bytes) -> bytes:
    """One byte: the sum of the record's bytes modulo 256."""
    return bytes([sum(record) & 0xFF])


@dataclass(frozen=True, slots=True)
class FoundRecord:
    """A record, and the number of records lost before it."""

    missed: int
    record: AtiRecord


class RecordDecoder(Protocol):
    """Decoder that is fed with received bytes, in pieces of any length."""

    malformed: int
    last_malformed: str

    def feed(self, data: bytes) -> list[FoundRecord]:
        """The records that `data` completes. Never raises: invalid data are counted in
        `malformed` and skipped.
        """
        ...


def record_stream(form: RecordForm) -> RecordDecoder:
    """A new decoder for records of this form."""
    if form is RecordForm.ASCII:
        return AsciiStream()
    return BinaryStream(form)


class AsciiStream:
    """Decoder of ASCII lines. Fields have a fixed width, so a line of another length than its
    neighbours lost or gained a character.

    The width is learned: two consecutive lines of the same new length are accepted. Text before the
    first record (echo, prompt) is ignored.
    """

    def __init__(self) -> None:
        self.malformed = 0
        self.last_malformed = ""
        self._held = b""
        self._width = self._odd_width = -1
        self._spoilt = 0

    def feed(self, data: bytes) -> list[FoundRecord]:
        *lines, self._held = (self._held + data).split(b"\n")
        # A line end that was lost must not let the buffer grow.
        if len(self._held) > LONGEST_LINE:
            lines = [*lines, self._held]
            self._held = b""
        return [record for line in lines if (record := self._decode_line(line + b"\n")) is not None]

    def _decode_line(self, line: bytes) -> FoundRecord | None:
        try:
            record = decode_record(line, RecordForm.ASCII)
            width = len(line)
            if width not in (self._width, self._odd_width):
                self._odd_width = width
                raise MalformedFrame(f"line of {width} characters among lines of {self._width}")
            self._width = width
            self._odd_width = -1
        except MalformedFrame as error:
            self._refuse(line, error)
            return None
        if self._spoilt:
            missed = max(1, round(self._spoilt / self._width))
        else:
            missed = 0
        self._spoilt = 0
        return FoundRecord(missed, record)

    def _refuse(self, line: bytes, error: MalformedFrame) -> None:
        """Count a malformed line and its characters.

        The characters give the number of lost records: a line that lost its end contains the next
        one, one that gained an end became two.
        """
        # Before the first record there is no width, and nothing was lost.
        if self._width > 0:
            self.malformed += 1
            self.last_malformed = str(error)
            self._spoilt += len(line)


class BinaryStream:
    """Decoder of binary records, which have a fixed length and no start mark.

    While records are valid, each begins where the one before ended. After an invalid one, an
    alignment is searched at which several consecutive records are valid. Without checksum there may
    be many; the one with the smallest changes of values is taken.
    """

    def __init__(self, form: RecordForm) -> None:
        self.malformed = 0
        self.last_malformed = ""
        self._form = form
        self._size = form.record_bytes
        self._held = bytearray()
        self._last: AtiRecord | None = None
        self._in_step = True
        self._skipped = 0

    def feed(self, data: bytes) -> list[FoundRecord]:
        self._held += data
        records = []
        while (record := self._next()) is not None:
            records.append(record)
        return records

    def _next(self) -> FoundRecord | None:
        if self._in_step and len(self._held) >= self._size:
            record = self._record_at(0)
            if record is not None and self._follows(record):
                return self._accept(record)
            self._in_step = False
            self.malformed += 1
            self.last_malformed = self._reason
        if not self._in_step and self._find_step():
            record = self._record_at(0)
            assert record is not None
            return self._accept(record)
        return None

    def _record_at(self, at: int) -> AtiRecord | None:
        try:
            return decode_record(bytes(self._held[at : at + self._size]), self._form)
        except MalformedFrame as error:
            self._reason = str(error)
            return None

    def _follows(self, record: AtiRecord) -> bool:
        if (
            self._last is None
            or self._form is RecordForm.BINARY_CHECKSUM
            or _jump(self._last, record) <= LARGEST_JUMP
        ):
            return True
        self._reason = (
            f"values jump by {_jump(self._last, record)} counts from one record to the next"
        )
        return False

    def _find_step(self) -> bool:
        """Skip to the best alignment; False where more bytes are needed to compare all
        alignments.
        """
        while len(self._held) >= (ALIGNED_RUN + 2) * self._size:
            at = self._best_alignment()
            self._skip(at or self._size)
            if at is not None:
                self._in_step = True
                return True
        return False

    def _best_alignment(self) -> int | None:
        """The best alignment within the length of two records, so that one damaged record does
        not hide the true one behind it.
        """
        steps = [n * self._size for n in range(ALIGNED_RUN)]
        fits = []
        for at in range(1, 2 * self._size + 1):
            if all(self._record_at(at + step) is not None for step in steps):
                fits.append(at)
        if not fits:
            return None
        best = min(fits, key=self._roughness)
        # The first offset of the same alignment: a later one would lose a good record.
        return min(at for at in fits if (at - best) % self._size == 0)

    def _roughness(self, at: int) -> int:
        records = [
            record
            for n in range(ALIGNED_RUN)
            if (record := self._record_at(at + n * self._size)) is not None
        ]
        return sum(_jump(before, after) for before, after in itertools.pairwise(records))

    def _skip(self, count: int) -> None:
        del self._held[:count]
        self._skipped += count

    def _accept(self, record: AtiRecord) -> FoundRecord:
        """Remove a record from the buffer; skipped bytes count as the records that they would
        fill, but not before the first record.
        """
        missed = 0
        if self._last is not None:
            missed = round(self._skipped / self._size)
        self._skipped = 0
        self._last = record
        del self._held[: self._size]
        return FoundRecord(missed, record)


def _jump(before: AtiRecord, after: AtiRecord) -> int:
    return max(abs(b - a) for a, b in zip(before.counts, after.counts, strict=True))


def without_echo(data: bytes, echo: bytes) -> bytes | None:
    """The data after the echoed command and its line end; None while these have not arrived
    completely.
    """
    at = data.find(echo + LINE_END)
    if at < 0:
        return None
    return data[at + len(echo) + len(LINE_END) :]
