"""Records out of the stream of bytes that an ATI F/T Controller sends, found again after noise; pure."""

import itertools
from dataclasses import dataclass
from typing import Protocol

from rfca_rig.codecs.ati_serial import LINE_END, AtiRecord, RecordForm, decode_record
from rfca_rig.codecs.malformed import MalformedFrame

LONGEST_LINE = 200
ALIGNED_RUN = 4  # so many records in a row must fit before an alignment of bytes is believed
LARGEST_JUMP = 2**13  # counts from one record to the next; more is a sign of bytes that are out of step


@dataclass(frozen=True, slots=True)
class FoundRecord:
    """A record, and how many were lost between the one before and it."""

    missed: int
    record: AtiRecord


class RecordDecoder(Protocol):
    """Fed with bytes as they come in, in pieces of any length."""

    malformed: int
    last_malformed: str

    def feed(self, data: bytes) -> list[FoundRecord]:
        """The records that `data` completes. Never raises: what is no record is counted in `malformed` and passed over."""
        ...


def record_stream(form: RecordForm) -> RecordDecoder:
    """An empty stream of records of that form."""
    return AsciiStream() if form is RecordForm.ASCII else BinaryStream(form)


class AsciiStream:
    """Lines. Fields have a fixed width, so a line of another length than its neighbours has lost or gained a character.

    The width is learned: two lines in a row of the same new length are believed. What comes before the first record (echo, prompt)
    counts as nothing.
    """

    def __init__(self) -> None:
        self.malformed = 0
        self.last_malformed = ""
        self._held = b""
        self._width = self._odd_width = -1
        self._spoilt = 0

    def feed(self, data: bytes) -> list[FoundRecord]:
        *lines, self._held = (self._held + data).split(b"\n")
        if len(self._held) > LONGEST_LINE:
            lines, self._held = [*lines, self._held], b""
        return [found for line in lines if (found := self._taken(line + b"\n")) is not None]

    def _taken(self, line: bytes) -> FoundRecord | None:
        try:
            record = decode_record(line, RecordForm.ASCII)
            self._check_width(len(line))
        except MalformedFrame as error:
            self._refuse(line, error)
            return None
        missed = max(1, round(self._spoilt / self._width)) if self._spoilt else 0
        self._spoilt = 0
        return FoundRecord(missed, record)

    def _check_width(self, width: int) -> None:
        if width not in (self._width, self._odd_width):
            self._odd_width = width
            raise MalformedFrame(f"line of {width} characters among lines of {self._width}")
        self._width, self._odd_width = width, -1

    def _refuse(self, line: bytes, error: MalformedFrame) -> None:
        """Its characters are kept count of: a line that lost its end swallowed the next, one that gained an end became two."""
        if self._width > 0:
            self.malformed += 1
            self.last_malformed = str(error)
            self._spoilt += len(line)


class BinaryStream:
    """Fixed lengths, no mark where a record begins.

    While records fit, the next begins where one ended. When one does not, an alignment is looked for at which several in a row
    fit; without checksum many may, and the one at which the values jump least is taken.
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
        found = []
        while (record := self._next()) is not None:
            found.append(record)
        return found

    def _next(self) -> FoundRecord | None:
        if self._in_step and len(self._held) >= self._size:
            record = self._record_at(0)
            if record is not None and self._follows(record):
                return self._accept(record)
            self._lose_step()
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
        if self._last is None or self._form is RecordForm.BINARY_CHECKSUM or _jump(self._last, record) <= LARGEST_JUMP:
            return True
        self._reason = f"values jump by {_jump(self._last, record)} counts from one record to the next"
        return False

    def _lose_step(self) -> None:
        self._in_step = False
        self.malformed += 1
        self.last_malformed = self._reason

    def _find_step(self) -> bool:
        """Skips to the best alignment, waiting for enough bytes to judge them all; False where more are needed."""
        while len(self._held) >= (ALIGNED_RUN + 2) * self._size:
            at = self._best_alignment()
            self._skip(at or self._size)
            if at is not None:
                self._in_step = True
                return True
        return False

    def _best_alignment(self) -> int | None:
        """Two records' lengths are searched, so that one damaged record does not hide the true alignment behind it."""
        fits = [at for at in range(1, 2 * self._size + 1) if self._fits(at)]
        if not fits:
            return None
        best = min(fits, key=self._roughness)
        return min(at for at in fits if (at - best) % self._size == 0)

    def _fits(self, at: int) -> bool:
        return all(self._record_at(at + n * self._size) is not None for n in range(ALIGNED_RUN))

    def _roughness(self, at: int) -> int:
        records = [record for n in range(ALIGNED_RUN) if (record := self._record_at(at + n * self._size)) is not None]
        return sum(_jump(before, after) for before, after in itertools.pairwise(records))

    def _skip(self, count: int) -> None:
        del self._held[:count]
        self._skipped += count

    def _accept(self, record: AtiRecord) -> FoundRecord:
        """Bytes that were skipped are as many records as they would fill; before the first record they are none."""
        missed = round(self._skipped / self._size) if self._last is not None else 0
        self._skipped = 0
        self._last = record
        del self._held[: self._size]
        return FoundRecord(missed, record)


def _jump(before: AtiRecord, after: AtiRecord) -> int:
    return max(abs(b - a) for a, b in zip(before.counts, after.counts, strict=True))


def without_echo(data: bytes, echo: bytes) -> bytes | None:
    """What follows the echoed command and its line end; None while these have not come in whole."""
    at = data.find(echo + LINE_END)
    return None if at < 0 else data[at + len(echo) + len(LINE_END) :]
