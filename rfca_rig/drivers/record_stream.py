"""Records of force sensors: counters of lost, duplicate, late, faulty, saturated and frozen ones,
for all drivers.

`RecordStream` is the base class of plug-in drivers, for devices that stream records as bytes. See
docs/add-a-force-sensor.md.
"""

import struct
from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, ClassVar, Generic, Protocol, TypeVar

import numpy as np
from numpy.typing import NDArray

from rfca_rig.clock import Clock
from rfca_rig.codecs.force_sensors import ERROR, SATURATED, WARNINGS
from rfca_rig.drivers.device_time import FrameCount
from rfca_rig.drivers.ports import SerialPort
from rfca_rig.drivers.reading_check import ReadingCheck, Signal, describe_bad
from rfca_rig.drivers.roles import ForceSamples, SensorScale, StreamHealth
from rfca_rig.errors import DeviceError

Ints = NDArray[np.int64]

# Number of missing records that are remembered, to recognise them if they come late.
MAX_MISSING_RECORDS = 100_000

# Bit 31, the summary error, is set for every error, so it does not identify saturation.
SATURATED_BIT = np.uint32(SATURATED & 0x7FFFFFFF)
MIN_FROZEN_RECORDS = 50

Floats = NDArray[np.float64]

FILES = ("file", "twin_file")
# Time for the answer to a command, and the interval between two polls for it, in s.
ANSWER_S = 1.0
POLL_S = 1e-3
# Time over which the rate is measured in s, and the relative difference that is accepted.
RATE_CHECK_S = 1.0
RATE_TOLERANCE = 0.03
# A generic error: bit 15 has no meaning on a Net F/T.
GENERIC_ERROR = ERROR | 1 << 15
# Counts are stored as int32.
MAX_COUNT = 2**31 - 1
COUNT_SIGNALS = tuple(
    Signal(axis, "counts", -MAX_COUNT, MAX_COUNT) for axis in ("fx", "fy", "fz", "tx", "ty", "tz")
)
TIME_SIGNAL = Signal("record time", "s", -1e12, 1e12)


class RecordSequence:
    """Follows a 32 bit counter that starts at `first` and wraps.

    From each batch the records that continue the stream are picked, in the order of their numbers.
    A record older than those already handed out is never handed out: it is a duplicate, or it is
    late and stays lost. Differences are signed 32 bit differences, so that an old record does not
    look four billion records ahead.
    """

    def __init__(self, first: int = 1) -> None:
        self._next = first
        self._missing: set[int] = set()
        self.received = self.lost = self.duplicate = self.out_of_order = 0

    def take(self, numbers: NDArray[np.uint32]) -> tuple[Ints, Ints]:
        """Sorts out one batch.

        Parameters
        ----------
        numbers : ndarray, shape (m,)
            Record numbers, 32 bit, in order of arrival.

        Returns
        -------
        picked : ndarray, shape (k,)
            Indices of the records to keep.
        unwrapped : ndarray, shape (k,)
            Their numbers without wrap, ascending.
        """
        # The view as int32 makes records behind `_next` negative.
        ahead = (numbers - np.uint32(self._next & 0xFFFFFFFF)).view(np.int32).astype(np.int64)
        # Fast path for a batch without gap, the usual case at 7000 to 15 000 records/s.
        picked = fresh = np.arange(len(ahead))
        if not len(ahead) or np.count_nonzero(ahead != picked):
            picked, fresh = self._sort_out(ahead)
        unwrapped = self._next + fresh
        self.received += len(fresh)
        if len(fresh):
            self._next += int(fresh[-1]) + 1
        return picked, unwrapped

    def health(
        self, status: "StatusCounter", stalled: int, malformed: int, notes: list[str]
    ) -> StreamHealth:
        """The health of the stream, from these counters and those that are given."""
        return StreamHealth(
            received=self.received,
            lost=self.lost,
            duplicate=self.duplicate,
            out_of_order=self.out_of_order,
            malformed=malformed,
            faulty_status=status.faulty,
            stalled=stalled,
            saturated=status.saturated,
            notes=notes,
        )

    def _sort_out(self, ahead: Ints) -> tuple[Ints, Ints]:
        for old in ahead[ahead < 0]:
            number = self._next + int(old)
            if number in self._missing:
                self._missing.remove(number)
                self.out_of_order += 1
            else:
                self.duplicate += 1
        new = np.flatnonzero(ahead >= 0)
        fresh, first = np.unique(ahead[new], return_index=True)
        self.duplicate += len(new) - len(fresh)
        # Counts records that a higher number overtook within the batch.
        order = ahead[new][np.sort(first)]
        if len(order):
            self.out_of_order += int((order < np.maximum.accumulate(order)).sum())
        self._count_gaps(fresh)
        return new[first], fresh

    def _count_gaps(self, fresh: Ints) -> None:
        if len(fresh) == 0:
            return
        lost = int(fresh[-1]) + 1 - len(fresh)
        self.lost += lost
        if len(self._missing) + lost > MAX_MISSING_RECORDS:
            # After such a gap late records are not worth the memory; they then count as duplicates.
            self._missing.clear()
        if 0 < lost <= MAX_MISSING_RECORDS:
            gaps = np.setdiff1d(np.arange(int(fresh[-1])), fresh, assume_unique=True)
            self._missing.update((self._next + gaps).tolist())


class StatusCounter:
    """Counts records with a bad status, and the saturated ones among them. All sensors use the
    status words of the Net F/T.
    """

    def __init__(self) -> None:
        self.faulty = self.saturated = 0
        self.seen = 0

    def take(self, status: NDArray[np.uint32]) -> None:
        """Counts one batch of status words (m,)."""
        if not np.count_nonzero(status):
            return
        faulty = status[~np.isin(status, list(WARNINGS))]
        self.faulty += len(faulty)
        self.saturated += int((faulty & SATURATED_BIT != 0).sum())
        self.seen |= int(np.bitwise_or.reduce(faulty, initial=0))


class FrozenRecordCounter:
    """Counts records that only repeat the one before, for sensors that number records but not
    measurements.

    A working converter is never constant for long in all six axes, so 50 equal records in a row
    count as frozen.
    """

    def __init__(self) -> None:
        self.frozen = 0
        self._last: NDArray[np.generic] | None = None
        self._run = 0

    def take(self, values: NDArray[np.generic]) -> None:
        """Counts one batch (m, n) of raw values, one column per axis or gage."""
        if not len(values):
            return
        before = self._last
        if before is None:
            before = values[:1]
        same = (values == np.concatenate([before, values[:-1]])).all(axis=1)
        if self._last is None:
            same[0] = False
        self._last = values[-1:].copy()
        # The usual case, without the loop over all records.
        if not same.any() and not self._run:
            return
        for repeats in same.tolist():
            if not repeats:
                self._run = 0
                continue
            self._run += 1
            # The whole run counts once it has reached the limit, then each further record.
            if self._run == MIN_FROZEN_RECORDS:
                self.frozen += MIN_FROZEN_RECORDS
            elif self._run > MIN_FROZEN_RECORDS:
                self.frozen += 1


class StreamKeys(Protocol):
    """Keys of [force_sensor] that every plug-in sensor has, besides its own."""

    @property
    def counts_per_N(self) -> float: ...
    @property
    def counts_per_Nm(self) -> float: ...
    @property
    def rate_Hz(self) -> float: ...
    @property
    def port(self) -> str: ...
    def model_dump(self) -> dict[str, Any]: ...


Keys = TypeVar("Keys", bound=StreamKeys)


@dataclass(frozen=True)
class Record:
    """One record: six counts (fx fy fz tx ty tz), and whether the device reports saturation or
    another error.

    `time_s` is the device's own clock, None if it has none; it may start anywhere and wrap.
    """

    counts: Sequence[float]
    is_saturated: bool = False
    is_wrong: bool = False
    time_s: float | None = None


def _encode_status(record: Record) -> int:
    if record.is_saturated:
        return SATURATED
    if record.is_wrong:
        return GENERIC_ERROR
    return 0


class RecordStream(ABC, Generic[Keys]):
    """A `ForceSensor` on a serial port, or on any object with the four members of `SerialPort`.

    Inherit, set `make`, the `header` that every record begins with ("" for none) and its length,
    and implement the decoding. This class handles resynchronisation after noise, time stamps,
    losses, the rate check, saturation, silence and a broken line.
    """

    make: ClassVar[str]
    header: ClassVar[bytes] = b""
    record_bytes: ClassVar[int]
    clock_wraps_s: ClassVar[float | None] = None

    def __init__(self, port: SerialPort, clock: Clock, keys: Keys) -> None:
        self.keys = keys
        self._port = port
        self._clock = clock
        self._running = False
        self._reset_stream(b"")

    # -- bytes of the device, to be implemented
    # ------------------------------------------------------------------------------

    @abstractmethod
    def to_start(self) -> Sequence[tuple[bytes, bytes]]:
        """Commands that start the stream, each with the answer to wait for (b"" for none). They
        must not send a bias.
        """

    @abstractmethod
    def to_stop(self) -> bytes:
        """Command that ends the stream; b"" for a device that always streams."""

    @abstractmethod
    def decode(self, record: bytes) -> Record | None:
        """Decodes `record_bytes` bytes, header included; None if the checksum is wrong, or they
        are not a record.
        """

    # -- ForceSensor
    # ----------------------------------------------------------------------------------------------

    def _reset_stream(self, buffer: bytes) -> None:
        self._buffer = bytearray(buffer)
        self._in_garbage = False
        self._sequence = RecordSequence()
        self._count = FrameCount(1.0 / self.keys.rate_Hz)
        self._number = 0
        self._elapsed_s = 0.0
        self._last_s: float | None = None
        self._status = StatusCounter()
        self._frozen = FrozenRecordCounter()
        self._check = ReadingCheck("the force sensor", *COUNT_SIGNALS, TIME_SIGNAL)
        self._malformed = 0
        self._received = 0
        self._rate_from: tuple[float, int] | None = None
        self._rate_checked = False
        self._heard_s = self._read_s = self._clock.now_s()

    def start(self) -> None:
        """Starts the stream. Raises DeviceError if the device does not answer."""
        self._running = False
        remainder = b""
        self._receive_bytes()
        for command, answer in self.to_start():
            # Records of an old stream may precede the answer.
            self._send(command)
            received = b""
            until_s = self._clock.now_s() + ANSWER_S
            while answer not in received:
                if self._clock.now_s() > until_s:
                    raise DeviceError(
                        f"force sensor on {self.keys.port} does not answer {command!r} "
                        f"with {answer!r} within {ANSWER_S:g} s, but sent "
                        f"{received[-40:]!r}; check its power, the cable, and port and "
                        "bits_per_s under [force_sensor]"
                    )
                self._clock.wait_until(self._clock.now_s() + POLL_S)
                received += self._receive_bytes()
            remainder = b""
            if answer:
                remainder = received.partition(answer)[2]
        # Bytes after the last answer already belong to the new stream.
        self._reset_stream(remainder)
        self._running = True

    def stop(self) -> None:
        """Ends the stream. Raises DeviceError if the line is broken."""
        self._running = False
        if self.to_stop():
            self._send(self.to_stop())

    def _send(self, data: bytes) -> None:
        try:
            self._port.write(data)
        except OSError as error:
            raise DeviceError(
                f"nothing to be sent on {self.keys.port}: {error}; check the cable"
            ) from error

    def _receive_bytes(self) -> bytes:
        try:
            waiting = self._port.in_waiting
            if waiting:
                return self._port.read(waiting)
            return b""
        except OSError as error:
            raise DeviceError(
                f"nothing to be received on {self.keys.port}: {error}; check the cable"
            ) from error

    def read(self) -> ForceSamples:
        """Records (m, 6) since the last call. Raises DeviceError if their rate differs from the
        rig file.
        """
        self._read_s = self._clock.now_s()
        arrived = self._receive_bytes()
        records = self._find_records(arrived) if self._running else []
        return self._samples(records)

    def _find_records(self, data: bytes) -> list[Record]:
        self._buffer += data
        records: list[Record] = []
        while len(self._buffer) >= self.record_bytes:
            record = self._record_at_head()
            if record is not None:
                records.append(record)
                del self._buffer[: self.record_bytes]
                self._in_garbage = False
            else:
                self._skip()
        return records

    def _record_at_head(self) -> Record | None:
        if not self._buffer.startswith(self.header):
            return None
        try:
            return self.decode(bytes(self._buffer[: self.record_bytes]))
        except (struct.error, ValueError, IndexError):
            # A plug-in decoder raises these on bytes that are not a record; they count as
            # malformed.
            return None

    def _skip(self) -> None:
        """Skips to the next possible start of a record; one stretch of garbage counts once."""
        self._malformed += not self._in_garbage
        self._in_garbage = True
        if self.header:
            next_header = self._buffer.find(self.header, 1)
        else:
            next_header = 1
        # Without a further header, the tail that could be the start of one is kept.
        if next_header <= 0:
            next_header = max(1, len(self._buffer) - len(self.header) + 1)
        del self._buffer[:next_header]

    def _samples(self, records: list[Record]) -> ForceSamples:
        is_good = [self._accept(record) for record in records]
        # A refused record has a place among the others all the same, as the time of records without
        # a clock comes from counting.
        accepted, numbers, device_s = self._stamp_records(records, is_good)
        status = np.array([_encode_status(record) for record in accepted], np.uint32)
        raw = np.array([record.counts for record in accepted], np.float64).reshape(-1, 6)
        # Only a record with an error may have counts that are no numbers; its status says not to
        # use them.
        counts = np.clip(np.rint(np.nan_to_num(raw)), -MAX_COUNT, MAX_COUNT).astype(np.int32)
        self._status.take(status)
        self._frozen.take(counts)
        self._received += len(accepted)
        if accepted:
            self._heard_s = self._read_s
            self._check_rate()
        return ForceSamples(np.full(len(accepted), self._read_s), device_s, numbers, status, counts)

    def _accept(self, record: Record) -> bool:
        """Whether the numbers of a record are possible. Raises BadReading at the third bad one
        in a row.
        """
        time_s = record.time_s
        if time_s is None:
            time_s = 0.0
        counts = record.counts
        # A record with an error is not measured by its counts.
        if record.is_saturated or record.is_wrong:
            counts = [0.0] * 6
        return self._check.accept(*counts, time_s)

    def _stamp_records(
        self, records: list[Record], is_good: list[bool]
    ) -> tuple[list[Record], NDArray[np.int64], Floats]:
        """The records to hand out, which are good ones, their numbers (m,), and device times
        (m,) in s, 0 at the first.
        """
        good = [record for record, accepted in zip(records, is_good, strict=True) if accepted]
        if not records or (not good and records[0].time_s is not None):
            return [], np.empty(0, np.int64), np.empty(0)
        if records[0].time_s is None:
            device_s = self._count.stamp(len(records), self._read_s)[np.array(is_good)]
            return good, np.rint(device_s * self.keys.rate_Hz).astype(np.int64) + 1, device_s
        records = good
        steps = [self._step(record.time_s) for record in records]
        picked, numbers = self._sequence.take(np.array([number for number, _ in steps], np.uint32))
        return (
            [records[index] for index in picked],
            numbers,
            np.array([steps[index][1] for index in picked]),
        )

    def _step(self, time_s: float | None) -> tuple[int, float]:
        """Number and time of a record relative to the newest one before, so the clock only has
        to be right from one to the next.
        """
        if time_s is None or self._last_s is None:
            self._last_s = time_s
            self._number = 1
            return 1, 0.0
        since_s = time_s - self._last_s
        wraps_s = self.clock_wraps_s
        if wraps_s is not None:
            # The shorter way around the wrap; a small negative step is a record that came late.
            since_s = (since_s + 0.5 * wraps_s) % wraps_s - 0.5 * wraps_s
        number = self._number + round(since_s * self.keys.rate_Hz)
        elapsed_s = self._elapsed_s + since_s
        if number > self._number:
            self._number = number
            self._elapsed_s = elapsed_s
            self._last_s = time_s
        return number, elapsed_s

    def _check_rate(self) -> None:
        """Checks the rate once, over the first second: a wrong one would stretch the time base
        of the whole recording.
        """
        if self._rate_from is None:
            self._rate_from = self._read_s, self._received
        elapsed_s = self._read_s - self._rate_from[0]
        first = self._rate_from[1]
        if self._rate_checked or elapsed_s < RATE_CHECK_S:
            return
        self._rate_checked = True
        real_Hz = (self._received - first) / elapsed_s
        set_Hz = self.keys.rate_Hz
        # One record more or less in the window is allowed on top of the tolerance.
        if abs(real_Hz - set_Hz) > RATE_TOLERANCE * set_Hz + 1.0 / RATE_CHECK_S:
            raise DeviceError(
                f"force sensor sends {real_Hz:.1f} records/s, the rig file says "
                f"{set_Hz:g}; put that into rate_Hz, or set the sensor to it"
            )

    @property
    def _lost(self) -> int:
        return self._sequence.lost + self._count.lost

    def scale(self) -> SensorScale:
        return SensorScale(self.keys.counts_per_N, self.keys.counts_per_Nm, self.keys.rate_Hz)

    def health(self) -> StreamHealth:
        """Counters since `start`."""
        counted = self._sequence.health(
            self._status, self._frozen.frozen, self._malformed, self._notes()
        )
        return replace(
            counted,
            received=self._received,
            lost=self._lost,
            malformed=self._malformed + sum(self._check.bad.values()),
        )

    def _notes(self) -> list[str]:
        notes = []
        silent_s = self._read_s - self._heard_s
        # Two record periods on top of 0.1 s, so that a slow sensor does not count as silent.
        if self._running and silent_s > 0.1 + 2.0 / self.keys.rate_Hz:
            if self._malformed and not self._received:
                reason = "bytes come, but none are records; check what it is set to send"
            else:
                reason = None
            notes.append(
                f"no record for {silent_s:.2f} s: {reason or 'check its power and the cable'}"
            )
        if self._frozen.frozen:
            notes.append(
                f"all six values stood still over {self._frozen.frozen} records: is the "
                "transducer connected?"
            )
        if self._status.faulty:
            notes.append(
                f"{self._status.faulty} records with an error of the sensor, "
                f"{self._status.saturated} of them beyond its range"
            )
        if self._check.bad:
            notes.append(
                f"records with impossible numbers were refused: {describe_bad(self._check.bad)}"
            )
        if self._malformed:
            notes.append(f"{self._malformed} pieces of the stream were no records")
        return notes

    def identity(self) -> dict[str, str]:
        """For the recording: the make, and all keys of the section except its files, which are
        recorded in full.
        """
        return {
            "make": self.make,
            "serial_number": "",
            **{
                name: str(value)
                for name, value in self.keys.model_dump().items()
                if value is not None and name not in FILES
            },
        }
