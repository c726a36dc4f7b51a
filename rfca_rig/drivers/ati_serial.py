"""An ATI F/T Controller (CTL, CON) on a serial port as the force sensor."""

from dataclasses import dataclass

import numpy as np

from rfca_rig.clock import Clock
from rfca_rig.codecs.ati_serial import PROMPT, SETUP, AtiCommand, RecordForm, encode_command
from rfca_rig.codecs.ati_serial_stream import FoundRecord, record_stream, without_echo
from rfca_rig.codecs.netbox_status import SATURATED
from rfca_rig.drivers.frame_count import FrameCount
from rfca_rig.drivers.roles import ForceSamples, SensorScale, StreamHealth
from rfca_rig.drivers.sensor_health import FrozenCount, StatusCount
from rfca_rig.drivers.serial_port import SerialPort
from rfca_rig.errors import BadInput, DeviceError

ANSWER_S = 0.5
POLL_S = 5e-3
RATE_CHECK_S = 1.0
RATE_TOLERANCE = 0.03
LONGEST_ECHO = 64


@dataclass(frozen=True)
class AtiSerialSettings:
    """Counts per unit stand in the controller's calibration certificate; its wire does not tell them.

    `rate_Hz` is what the controller sends in `form`, which its averaging and the line's speed decide; `start` measures it.
    Raises BadInput for a rate that the line cannot carry.
    """

    counts_per_N: float
    counts_per_Nm: float
    rate_Hz: float
    form: RecordForm = RecordForm.ASCII
    bits_per_s: int = 38_400
    address: str = ""
    serial_number: str = ""

    def __post_init__(self) -> None:
        for name in ("counts_per_N", "counts_per_Nm", "rate_Hz", "bits_per_s"):
            if not 0.0 < getattr(self, name) < float("inf"):
                raise BadInput(f"force sensor: {name} is {getattr(self, name)}, must be above 0")
        most_Hz = self.bits_per_s / (10.0 * self.form.record_bytes)
        if self.rate_Hz > most_Hz * (1.0 + 1e-9):
            raise BadInput(
                f"force sensor: rate_Hz is {self.rate_Hz:g}, at {self.bits_per_s} bit/s the line carries {most_Hz:.1f} records/s "
                f"in the form {self.form.value!r}; lower rate_Hz or take the form 'binary-checksum'"
            )


class AtiSerialSensor:
    """A `ForceSensor` over a serial port. Never sends a bias: taring is the protocol's business.

    Records carry no number. What is lost shows as bytes that are no records, and as records that fall behind the host's clock;
    both move the sample counter on. Records cannot come twice or out of order on a line.
    """

    def __init__(self, port: SerialPort, clock: Clock, settings: AtiSerialSettings) -> None:
        self._port = port
        self._clock = clock
        self._settings = settings
        self._running = False
        self._begin_anew()

    def _begin_anew(self) -> None:
        self._stream = record_stream(self._settings.form)
        self._count = FrameCount(1.0 / self._settings.rate_Hz)
        self._status, self._frozen = StatusCount(), FrozenCount()
        self._head: bytes | None = b""
        self._received = self._garbled = 0
        self._first_s: float | None = None
        self._first_batch = 0
        self._rate_checked = False
        self._heard_s = self._read_s = self._clock.now_s()

    def start(self) -> None:
        """Sets the controller up and starts its stream. Raises DeviceError, with the command, where it does not answer."""
        for command in (AtiCommand.NOTHING, *SETUP[self._settings.form]):
            self._ask(command)
        self._begin_anew()
        self._send(AtiCommand.QUERY_STREAM)
        self._running = True

    def _ask(self, command: AtiCommand) -> None:
        """Sends a command and waits for the prompt after its echo; what an earlier stream left on the line may come before."""
        self._send(command)
        answer, deadline_s = b"", self._clock.now_s() + ANSWER_S
        while PROMPT not in (answer.partition(command)[2] if command else answer):
            if self._clock.now_s() > deadline_s:
                raise DeviceError(_no_answer(command, answer, self._settings))
            self._clock.wait_until(self._clock.now_s() + POLL_S)
            answer += self._arrived()

    def stop(self) -> None:
        """Raises DeviceError when the line is broken."""
        self._running = False
        self._send(AtiCommand.NOTHING)

    def bias(self) -> None:
        """Has the controller take what it feels now for zero, and starts anew; to be called with nothing on the sensor."""
        was_running, self._running = self._running, False
        for command in (AtiCommand.NOTHING, AtiCommand.BIAS):
            self._ask(command)
        if was_running:
            self.start()

    def _send(self, command: AtiCommand) -> None:
        try:
            self._port.write(encode_command(command))
        except OSError as error:
            raise DeviceError(f"nothing to be sent on {self._settings.address}: {error}; check the cable") from error

    def _arrived(self) -> bytes:
        try:
            waiting = self._port.in_waiting
            return self._port.read(waiting) if waiting else b""
        except OSError as error:
            raise DeviceError(f"nothing to be received on {self._settings.address}: {error}; check the cable") from error

    def read(self) -> ForceSamples:
        """Records since the last call. Raises DeviceError when they come at another rate than configured."""
        self._read_s = self._clock.now_s()
        data = self._without_head(self._arrived())
        found = self._stream.feed(data) if self._running else []
        return self._samples(found)

    def _without_head(self, data: bytes) -> bytes:
        """Without the echo of the command that started the stream."""
        if self._head is None:
            return data
        self._head += data
        rest = without_echo(self._head, AtiCommand.QUERY_STREAM)
        if rest is None and len(self._head) < LONGEST_ECHO:
            return b""
        data, self._head = self._head if rest is None else rest, None
        return data

    def _samples(self, found: list[FoundRecord]) -> ForceSamples:
        places = np.cumsum([one.missed + 1 for one in found], dtype=np.int64) - 1
        stamps_s = self._count.stamp(int(places[-1]) + 1 if len(found) else 0, self._read_s)[places]
        counts = np.array([one.record.counts for one in found], np.int32).reshape(-1, 6)
        status = np.where([one.record.error for one in found], np.uint32(SATURATED), np.uint32(0)).astype(np.uint32)
        if found:
            self._inspect(counts, status, int(places[-1]) + 1)
        numbers = np.rint(stamps_s * self._settings.rate_Hz).astype(np.int64) + 1
        return ForceSamples(np.full(len(found), self._read_s), stamps_s, numbers, status, counts)

    def _inspect(self, counts: np.ndarray, status: np.ndarray, sent: int) -> None:
        self._heard_s = self._read_s
        self._status.take(status)
        self._frozen.take(counts)
        self._check_rate(sent)
        self._received += len(counts)
        self._garbled += sent - len(counts)

    def _check_rate(self, sent: int) -> None:
        """Once, over the first second: a wrong rate would stretch the time base of the whole recording."""
        if self._first_s is None:
            self._first_s, self._first_batch = self._read_s, sent
        elif not self._rate_checked and self._read_s - self._first_s >= RATE_CHECK_S:
            self._rate_checked = True
            rate_Hz = (self._received + self._garbled + sent - self._first_batch) / (self._read_s - self._first_s)
            slack_Hz = RATE_TOLERANCE * self._settings.rate_Hz + 1.0 / RATE_CHECK_S
            if abs(rate_Hz - self._settings.rate_Hz) > slack_Hz:
                raise DeviceError(
                    f"force sensor sends {rate_Hz:.1f} records/s, the settings say {self._settings.rate_Hz:g}; "
                    "put that into rate_Hz, or change the controller's averaging (SA) and sampling (SF)"
                )

    def silent_s(self) -> float:
        """Time from the `read` that last brought a record, or from the start, to the last `read`."""
        return self._read_s - self._heard_s

    def scale(self) -> SensorScale:
        return SensorScale(self._settings.counts_per_N, self._settings.counts_per_Nm, self._settings.rate_Hz)

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
        if self._running and self.silent_s() > 0.1 + 2.0 / self._settings.rate_Hz:
            notes.append(f"no record for {self.silent_s():.2f} s: {self._why_silent()}")
        if self._frozen.frozen:
            notes.append(f"all six values stood still over {self._frozen.frozen} records: is the transducer connected?")
        if self._status.faulty:
            notes.append(f"error flag in {self._status.faulty} records: saturated, or the transducer is not connected")
        if self._stream.malformed:
            notes.append(f"{self._stream.malformed} pieces of the stream were no records, the last one: {self._stream.last_malformed}")
        return notes

    def _why_silent(self) -> str:
        if self._stream.malformed and not self._received:
            return "bytes come, but none are records; try another form, and without checksum"
        return "check the controller's power and the cable"

    def identity(self) -> dict[str, str]:
        return {
            "make": f"ATI F/T Controller, serial, {self._settings.form.value}",
            "address": self._settings.address,
            "serial_number": self._settings.serial_number,
            "counts_per_N": repr(self._settings.counts_per_N),
            "counts_per_Nm": repr(self._settings.counts_per_Nm),
            "rate_Hz": f"{self._settings.rate_Hz:.6g}",
        }


def _no_answer(command: AtiCommand, answer: bytes, settings: AtiSerialSettings) -> str:
    asked = f"to {bytes(command).decode()!r}" if command else "to a carriage return"
    heard = f"it said {answer[-40:]!r}" if answer else "it said nothing"
    return (
        f"F/T controller on {settings.address or 'its serial port'} gives no prompt {asked} within {ANSWER_S:g} s, {heard}; "
        f"check its power, the cable, and that it is set to {settings.bits_per_s} bit/s"
    )
