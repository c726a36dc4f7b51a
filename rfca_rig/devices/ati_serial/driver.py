"""Driver for an ATI F/T Controller (CTL, CON) on a serial port."""

import numpy as np

from rfca_rig.clock import Clock
from rfca_rig.codecs.force_sensors import SATURATED
from rfca_rig.devices.ati_serial.codec import (
    PROMPT,
    SETUP,
    AtiCommand,
    FoundRecord,
    encode_command,
    record_stream,
    without_echo,
)
from rfca_rig.devices.ati_serial.section import AtiSerialSection
from rfca_rig.drivers.device_time import FrameCount
from rfca_rig.drivers.ports import SerialPort
from rfca_rig.drivers.record_stream import FrozenRecordCounter, StatusCounter
from rfca_rig.drivers.roles import ForceSamples, SensorScale, StreamHealth
from rfca_rig.errors import DeviceError

# Time for the prompt after a command, and the interval between two polls for it, in s.
ANSWER_S = 0.5
POLL_S = 5e-3
# Time over which the rate is measured in s, and the relative difference that is accepted.
RATE_CHECK_S = 1.0
RATE_TOLERANCE = 0.03
# Bytes after which the echo of the start command is no longer expected.
LONGEST_ECHO = 64


class AtiSerialSensor:
    """A `ForceSensor` over a serial port. Sends a bias only in `bias`: taring belongs to the
    experiment.

    Records carry no number. A loss shows as bytes that are not records, and as records that lag
    behind the host clock; both advance the sample counter. Records cannot be duplicated or
    reordered on a serial line.
    """

    def __init__(self, port: SerialPort, clock: Clock, keys: AtiSerialSection) -> None:
        self._port = port
        self._clock = clock
        self._keys = keys
        self._running = False
        self._reset()

    def _reset(self) -> None:
        self._stream = record_stream(self._keys.form)
        self._count = FrameCount(1.0 / self._keys.rate_Hz)
        self._status = StatusCounter()
        self._frozen = FrozenRecordCounter()
        self._head: bytes | None = b""
        self._received = self._garbled = 0
        self._first_s: float | None = None
        self._first_batch = 0
        self._rate_checked = False
        self._heard_s = self._read_s = self._clock.now_s()

    def start(self) -> None:
        """Sets up the controller and starts its stream. Raises DeviceError, with the command, if
        it does not answer.
        """
        # A bare carriage return first: it ends a stream that an earlier program left running.
        for command in (AtiCommand.NOTHING, *SETUP[self._keys.form]):
            self._ask(command)
        self._reset()
        self._send(AtiCommand.QUERY_STREAM)
        self._running = True

    def _ask(self, command: AtiCommand) -> None:
        """Sends a command and waits for the prompt after its echo. Remains of an earlier stream
        may precede it.
        """
        self._send(command)
        answer = b""
        deadline_s = self._clock.now_s() + ANSWER_S
        while PROMPT not in (answer.partition(command)[2] if command else answer):
            if self._clock.now_s() > deadline_s:
                if command:
                    request = f"to {bytes(command).decode()!r}"
                else:
                    request = "to a carriage return"
                if answer:
                    reply = f"but sent {answer[-40:]!r}"
                else:
                    reply = "and sent nothing"
                raise DeviceError(
                    f"F/T controller on {self._keys.port} gives no prompt {request} "
                    f"within {ANSWER_S:g} s, {reply}; "
                    "check its power, the cable, and that it is set to "
                    f"{self._keys.bits_per_s} bit/s"
                )
            self._clock.wait_until(self._clock.now_s() + POLL_S)
            answer += self._receive()

    def stop(self) -> None:
        """Ends the stream. Raises DeviceError if the line is broken."""
        self._running = False
        self._send(AtiCommand.NOTHING)

    def bias(self) -> None:
        """Makes the controller take its present load as zero, and restarts a running stream;
        call it with the sensor unloaded.
        """
        was_running = self._running
        self._running = False
        for command in (AtiCommand.NOTHING, AtiCommand.BIAS):
            self._ask(command)
        if was_running:
            self.start()

    def _send(self, command: AtiCommand) -> None:
        try:
            self._port.write(encode_command(command))
        except OSError as error:
            raise DeviceError(
                f"nothing to be sent on {self._keys.port}: {error}; check the cable"
            ) from error

    def _receive(self) -> bytes:
        try:
            waiting = self._port.in_waiting
            if waiting:
                return self._port.read(waiting)
            return b""
        except OSError as error:
            raise DeviceError(
                f"nothing to be received on {self._keys.port}: {error}; check the cable"
            ) from error

    def read(self) -> ForceSamples:
        """Records (m, 6) since the last call. Raises DeviceError if their rate differs from the
        settings.
        """
        self._read_s = self._clock.now_s()
        data = self._without_head(self._receive())
        records = self._stream.feed(data) if self._running else []
        return self._samples(records)

    def _without_head(self, data: bytes) -> bytes:
        """Removes the echo of the command that started the stream."""
        if self._head is None:
            return data
        self._head += data
        remainder = without_echo(self._head, AtiCommand.QUERY_STREAM)
        if remainder is None and len(self._head) < LONGEST_ECHO:
            return b""
        if remainder is None:
            remainder = self._head
        self._head = None
        return remainder

    def _samples(self, records: list[FoundRecord]) -> ForceSamples:
        # Records missed before each found one take up their time slots.
        places = np.cumsum([entry.missed + 1 for entry in records], dtype=np.int64) - 1
        count = 0
        if records:
            count = int(places[-1]) + 1
        stamps_s = self._count.stamp(count, self._read_s)[places]
        counts = np.array([entry.record.counts for entry in records], np.int32).reshape(-1, 6)
        # The controller has one error flag for saturation and a disconnected transducer; it is
        # reported as saturation.
        status = np.where(
            [entry.record.error for entry in records], np.uint32(SATURATED), np.uint32(0)
        ).astype(np.uint32)
        if records:
            self._inspect(counts, status, count)
        # The record number follows from the device time, so that losses leave gaps in it.
        numbers = np.rint(stamps_s * self._keys.rate_Hz).astype(np.int64) + 1
        return ForceSamples(np.full(len(records), self._read_s), stamps_s, numbers, status, counts)

    def _inspect(self, counts: np.ndarray, status: np.ndarray, sent: int) -> None:
        self._heard_s = self._read_s
        self._status.take(status)
        self._frozen.take(counts)
        self._check_rate(sent)
        self._received += len(counts)
        self._garbled += sent - len(counts)

    def _check_rate(self, sent: int) -> None:
        """Checks the rate once, over the first second: a wrong one would stretch the time base
        of the whole recording.
        """
        if self._first_s is None:
            # The first batch may have accumulated before the first read, so it is not counted.
            self._first_s = self._read_s
            self._first_batch = sent
        elif not self._rate_checked and self._read_s - self._first_s >= RATE_CHECK_S:
            self._rate_checked = True
            rate_Hz = (self._received + self._garbled + sent - self._first_batch) / (
                self._read_s - self._first_s
            )
            slack_Hz = RATE_TOLERANCE * self._keys.rate_Hz + 1.0 / RATE_CHECK_S
            if abs(rate_Hz - self._keys.rate_Hz) > slack_Hz:
                raise DeviceError(
                    f"force sensor sends {rate_Hz:.1f} records/s, the settings say "
                    f"{self._keys.rate_Hz:g}; "
                    "put that into rate_Hz, or change the controller's averaging (SA) "
                    "and sampling (SF)"
                )

    def silent_s(self) -> float:
        """Time in s from the last `read` with a record, or from the start, to the last `read`."""
        return self._read_s - self._heard_s

    def scale(self) -> SensorScale:
        return SensorScale(self._keys.counts_per_N, self._keys.counts_per_Nm, self._keys.rate_Hz)

    def health(self) -> StreamHealth:
        """Counters since `start`."""
        return StreamHealth(
            received=self._received,
            lost=self._garbled + self._count.lost,
            malformed=self._stream.malformed,
            faulty_status=self._status.faulty,
            stalled=self._frozen.frozen,
            saturated=self._status.saturated,
            notes=self._notes(),
        )

    def _notes(self) -> list[str]:
        notes = []
        if self._running and self.silent_s() > 0.1 + 2.0 / self._keys.rate_Hz:
            why = "check the controller's power and the cable"
            if self._stream.malformed and not self._received:
                why = "bytes come, but none are records; try another form, and without checksum"
            notes.append(f"no record for {self.silent_s():.2f} s: {why}")
        if self._frozen.frozen:
            notes.append(
                f"all six values stood still over {self._frozen.frozen} records: is the "
                "transducer connected?"
            )
        if self._status.faulty:
            notes.append(
                f"error flag in {self._status.faulty} records: saturated, or the "
                "transducer is not connected"
            )
        if self._stream.malformed:
            notes.append(
                f"{self._stream.malformed} pieces of the stream were no records, the last "
                f"one: {self._stream.last_malformed}"
            )
        return notes

    def identity(self) -> dict[str, str]:
        return {
            "make": f"ATI F/T Controller, serial, {self._keys.form.value}",
            "address": self._keys.port,
            "serial_number": "",
            "counts_per_N": repr(self._keys.counts_per_N),
            "counts_per_Nm": repr(self._keys.counts_per_Nm),
            "rate_Hz": f"{self._keys.rate_Hz:.6g}",
        }


def make_driver(keys: AtiSerialSection, port: SerialPort, clock: Clock) -> AtiSerialSensor:
    """The driver of the controller that [force_sensor] names."""
    return AtiSerialSensor(port, clock, keys)
