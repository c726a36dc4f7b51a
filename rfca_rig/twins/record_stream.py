"""Base class of plug-in sensor twins, for devices that stream records over a serial line."""

from abc import ABC, abstractmethod
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from rfca_rig.twins.wires import SampleGrid, SerialLine

Floats = NDArray[np.float64]


class TwinnedStream(Protocol):
    """Keys of [force_sensor] that the twin needs."""

    @property
    def rate_Hz(self) -> float: ...


class RecordStreamTwin(ABC):
    """Handles noise, range and time. Inherit, and implement the commands and the record format.

    A world advances it in steps: `take_requests`, `due`, then, after the plant has moved, `take_wrench`.
    """

    # Range per axis, in N and N m.
    full_scale: tuple[float, ...] = (1000.0,) * 3 + (50.0,) * 3

    def __init__(self, line: SerialLine, keys: TwinnedStream, noise_std: tuple[float, ...], random: np.random.Generator) -> None:
        """`noise_std`: noise standard deviation of a sample per axis, in N and N m."""
        self._line = line
        self._ticks = SampleGrid(1.0 / keys.rate_Hz)
        self._noise_std, self._range = np.array(noise_std), np.array(self.full_scale)
        self._random = random
        self.is_streaming = False

    @abstractmethod
    def obey(self, data: bytes) -> bytes:
        """Executes received bytes, sets `is_streaming`; returns the answer."""

    @abstractmethod
    def record(self, time_s: float, wrench: tuple[float, ...], is_saturated: bool) -> bytes:
        """Encodes one record from the device's own time in s and six values in N and N m."""

    def take_requests(self) -> None:
        """Executes commands received since the last step."""
        if data := self._line.read():
            self._line.write(self.obey(data))

    def due(self, to_s: float) -> Floats:
        """Sample times (m,) in s in the step that ends at `to_s`; none without a stream."""
        times_s = self._ticks.until(to_s)
        self._due_s = times_s if self.is_streaming else times_s[:0]
        return self._due_s

    def take_wrench(self, wrench: Floats) -> None:
        """Takes the true wrench (m, 6), in N and N m, at the times that were due, and sends a record for each."""
        noisy = wrench + self._random.standard_normal(wrench.shape) * self._noise_std
        clipped = np.clip(noisy, -self._range, self._range)
        for time_s, values, saturated in zip(self._due_s.tolist(), clipped.tolist(), (clipped != noisy).any(axis=1).tolist(), strict=True):
            self._line.write(self.record(time_s, tuple(values), saturated))
