"""Twin of an ATI F/T Controller on a serial line."""

from dataclasses import dataclass
from math import ceil

import numpy as np
from numpy.typing import NDArray

from rfca_rig.devices.ati_serial.codec import (
    END,
    LINE_END,
    MAX_COUNT,
    PROMPT,
    AtiCommand,
    AtiRecord,
    RecordForm,
    encode_record,
)
from rfca_rig.devices.ati_serial.section import AtiSerialSection
from rfca_rig.twin_server.open_ports import SensorWire
from rfca_rig.twins.wires import SampleGrid, SerialLine

Floats = NDArray[np.float64]

# A start bit, eight data bits, a stop bit.
BITS_PER_BYTE = 10
LONGEST_COMMAND = 80

WIRE = SensorWire("F/T controller")


@dataclass(frozen=True)
class AtiSerialTwinSettings:
    """Settings of the controller, and noise standard deviation and range of the transducer per
    axis, in N and N m.

    The default scale is that of a Gamma SI-65-5. A record is sent at every n-th sample, with the
    smallest n that the line can carry at `bits_per_s`.
    """

    counts_per_N: float = 20.0
    counts_per_Nm: float = 1000.0 / 3.0
    sampling_Hz: float = 250.0
    bits_per_s: int = 38_400
    noise_std: tuple[float, ...] = (0.0,) * 6
    full_scale: tuple[float, ...] = (65.0, 65.0, 200.0, 5.0, 5.0, 5.0)


class AtiSerialTwin:
    """Echoes commands, executes them and prompts; streams after `QS` until the next carriage
    return. Uses ASCII after power-up.

    A world advances it in steps: `take_requests`, `due`, then, after the plant has moved,
    `take_wrench`.
    """

    def __init__(
        self, line: SerialLine, settings: AtiSerialTwinSettings, random: np.random.Generator
    ) -> None:
        self._line = line
        self._settings = settings
        self._random = random
        self._ticks = SampleGrid(1.0 / settings.sampling_Hz)
        self._typed = b""
        self._binary = self._with_checksum = False
        self._streaming = self._one_wanted = self._bias_wanted = False
        self._biases: list[Floats] = []
        self._counts_per_unit = np.repeat([settings.counts_per_N, settings.counts_per_Nm], 3)
        self._noise_std = np.array(settings.noise_std)
        self._full_scale = np.array(settings.full_scale)

    @property
    def form(self) -> RecordForm:
        """The record format in use."""
        if not self._binary:
            return RecordForm.ASCII
        if self._with_checksum:
            return RecordForm.BINARY_CHECKSUM
        return RecordForm.BINARY

    @property
    def record_rate_Hz(self) -> float:
        """Record rate of a stream in the present format, in Hz."""
        return self._settings.sampling_Hz / self._every

    @property
    def _every(self) -> int:
        bits = self.form.record_bytes * BITS_PER_BYTE
        return max(1, ceil(self._settings.sampling_Hz * bits / self._settings.bits_per_s - 1e-9))

    def take_requests(self) -> None:
        """Executes received commands. A line that is not a command is answered by the prompt
        alone.
        """
        for number in self._line.read():
            self._handle_character(bytes([number]))

    def _handle_character(self, character: bytes) -> None:
        if character != END:
            # While streaming only the carriage return counts; an echo would break up the records.
            if not self._streaming and len(self._typed) < LONGEST_COMMAND:
                self._typed += character
                self._line.write(character)
            return
        command = self._typed.strip().upper()
        self._typed = b""
        self._streaming = False
        self._line.write(LINE_END)
        self._obey(command)
        if not (self._streaming or self._one_wanted):
            self._line.write(PROMPT)

    def _obey(self, command: bytes) -> None:
        if command in {AtiCommand.ASCII, AtiCommand.BINARY}:
            self._binary = command == AtiCommand.BINARY
        elif command in {AtiCommand.CHECKSUM_ON, AtiCommand.CHECKSUM_OFF}:
            self._with_checksum = command == AtiCommand.CHECKSUM_ON
        elif command in {AtiCommand.QUERY_STREAM, AtiCommand.QUERY_RECORD}:
            self._streaming = command == AtiCommand.QUERY_STREAM
            self._one_wanted = command == AtiCommand.QUERY_RECORD
        elif command == AtiCommand.BIAS:
            self._bias_wanted = True
        elif command == AtiCommand.UNBIAS:
            self._biases = self._biases[:-1]
        elif command == AtiCommand.UNBIAS_ALL:
            self._biases = []

    def due(self, to_s: float) -> Floats:
        """Sample times (m,) in s in the step that ends at `to_s`; none while no record was
        requested.
        """
        first = self._ticks.taken + 1
        times_s = self._ticks.until(to_s)
        if self._one_wanted or self._bias_wanted:
            return times_s
        interval = self._every
        # Every n-th sample of the grid since power-up, across the borders of steps.
        if self._streaming:
            return times_s[(-first) % interval :: interval]
        return times_s[:0]

    def take_wrench(self, wrench: Floats) -> None:
        """Takes the true wrench (m, 6), in N and N m, at the times that were due, and sends a
        record for each.
        """
        if not len(wrench):
            return
        if self._bias_wanted:
            # Biases form a stack: `SZ` clears all, the other command the last one.
            self._biases.append(wrench[-1].copy())
            self._bias_wanted = False
        if self._one_wanted:
            self._one_wanted = False
            self._send(wrench[-1:])
            self._line.write(PROMPT)
        elif self._streaming:
            self._send(wrench)

    def _send(self, wrench: Floats) -> None:
        noisy = wrench + self._random.standard_normal(wrench.shape) * self._noise_std
        clipped = np.clip(noisy, -self._full_scale, self._full_scale)
        # The range applies to the load itself; the bias is subtracted afterwards.
        saturated = (clipped != noisy).any(axis=1)
        bias = np.zeros(6)
        if self._biases:
            bias = self._biases[-1]
        counts = np.clip(
            np.rint((clipped - bias) * self._counts_per_unit), -MAX_COUNT, MAX_COUNT
        ).astype(int)
        for error, (fx, fy, fz, tx, ty, tz) in zip(
            saturated.tolist(), counts.tolist(), strict=True
        ):
            self._line.write(
                encode_record(AtiRecord(int(error), (fx, fy, fz, tx, ty, tz)), self.form)
            )


def make_twin(
    line: SerialLine,
    keys: AtiSerialSection,
    noise_std: tuple[float, ...],
    random: np.random.Generator,
) -> AtiSerialTwin:
    """The twin of the controller that [force_sensor] names, with a transducer whose full scale
    is the largest count of 16 bits.
    """
    settings = keys.to_dataclass(
        AtiSerialTwinSettings,
        sampling_Hz=keys.rate_Hz,
        noise_std=noise_std,
        full_scale=(MAX_COUNT / keys.counts_per_N,) * 3 + (MAX_COUNT / keys.counts_per_Nm,) * 3,
    )
    return AtiSerialTwin(line, settings, random)
