"""The sensor's side of a serial line, for any device that streams records: what the twin of a lab's own sensor is made of."""

from abc import ABC, abstractmethod
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from rfca_rig.twins.serial_line import SerialLine
from rfca_rig.twins.ticks import Ticks

Floats = NDArray[np.float64]


class TwinnedStream(Protocol):
    """What the twin needs of [force_sensor]."""

    @property
    def rate_Hz(self) -> float: ...


class RecordStreamTwin(ABC):
    """Holds noise, range and time; inherit, and say what commands do and what a record looks like.

    A world brings it forward step by step: `take_requests`, `due`, then, after the plant moved, `measured`.
    """

    full_scale: tuple[float, ...] = (1000.0,) * 3 + (50.0,) * 3  # range per axis, in N and N m

    def __init__(self, line: SerialLine, keys: TwinnedStream, noise_std: tuple[float, ...], random: np.random.Generator) -> None:
        """`noise_std` of a sample per axis, in N and N m."""
        self._line = line
        self._ticks = Ticks(1.0 / keys.rate_Hz)
        self._noise_std, self._range = np.array(noise_std), np.array(self.full_scale)
        self._random = random
        self.is_streaming = False

    @abstractmethod
    def obey(self, data: bytes) -> bytes:
        """Does what the bytes order, sets `is_streaming`; returns the answer."""

    @abstractmethod
    def record(self, time_s: float, wrench: tuple[float, ...], is_saturated: bool) -> bytes:
        """The bytes of one record: the device's own time, and six values in N and N m."""

    def take_requests(self) -> None:
        """Obeys what has come in since the last step."""
        if data := self._line.read():
            self._line.write(self.obey(data))

    def due(self, to_s: float) -> Floats:
        """Sample times (m,) in the step that ends at `to_s`; none while nobody wants any."""
        times_s = self._ticks.until(to_s)
        self._due_s = times_s if self.is_streaming else times_s[:0]
        return self._due_s

    def measured(self, wrench: Floats) -> None:
        """Takes the true wrench (m, 6) at the times that were due, and sends a record for each."""
        felt = wrench + self._random.standard_normal(wrench.shape) * self._noise_std
        within = np.clip(felt, -self._range, self._range)
        for time_s, values, saturated in zip(self._due_s.tolist(), within.tolist(), (within != felt).any(axis=1).tolist(), strict=True):
            self._line.write(self.record(time_s, tuple(values), saturated))
