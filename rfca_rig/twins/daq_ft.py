"""A DAQ F/T transducer and the card that samples it: wrench to gage voltages through the inverse matrix, as 16 bit codes."""

from collections import deque
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from rfca_rig.codecs.ati_calibration import GAGES, TransducerCalibration
from rfca_rig.codecs.gage_block import GageBlock
from rfca_rig.twins.ticks import Ticks

Floats = NDArray[np.float64]

CODES = 1 << 16


@dataclass(frozen=True)
class DaqFtTwinSettings:
    """The card's clock and its store, the transducer's voltages without load, the spread of its noise per axis in N and N m.

    A store that nobody empties within `store_s` runs over, and the oldest samples are lost.
    """

    sampling_Hz: float = 15_000.0
    unloaded_V: tuple[float, ...] = (0.0,) * GAGES
    noise_std: tuple[float, ...] = (0.0,) * GAGES
    store_s: float = 2.0


@dataclass
class _Store:
    """Blocks that wait to be read, and how many samples they hold."""

    blocks: deque[GageBlock] = field(default_factory=deque)
    held: int = 0

    def add(self, block: GageBlock, room: int) -> None:
        self.blocks.append(block)
        self.held += len(block.volts)
        while self.held > room:
            self.held -= len(self.blocks.popleft().volts)


class DaqFtTwin:
    """Is itself what a driver reads voltages from. Brought forward step by step by a world: `due`, then `measured`."""

    def __init__(self, calibration: TransducerCalibration, settings: DaqFtTwinSettings, random: np.random.Generator) -> None:
        self._calibration = calibration
        self._settings = settings
        self._random = random
        self._ticks = Ticks(1.0 / settings.sampling_Hz)
        self._unloaded_V, self._noise_std = np.array(settings.unloaded_V), np.array(settings.noise_std)
        self._running = False
        self._taken = 0
        self._store = _Store()

    def start(self) -> float:
        """Samples count from 0 again; returns the samples per second."""
        self._running = True
        self._taken = 0
        self._store = _Store()
        return self._settings.sampling_Hz

    def stop(self) -> None:
        self._running = False

    def read(self) -> list[GageBlock]:
        """What was sampled since the last call."""
        blocks = list(self._store.blocks)
        self._store = _Store()
        return blocks

    def identity(self) -> dict[str, str]:
        return {"card": "twin, 16 bit", "card_rate_Hz": f"{self._settings.sampling_Hz:.6g}"}

    def take_requests(self) -> None:
        """A card obeys at once, so there is nothing to take in."""

    def due(self, to_s: float) -> Floats:
        """Sample times (m,) in the step that ends at `to_s`; none while the card stands."""
        times_s = self._ticks.until(to_s)
        return times_s if self._running else times_s[:0]

    def measured(self, wrench: Floats) -> None:
        """Takes the true wrench (m, 6) at the times that were due."""
        if not len(wrench):
            return
        felt = wrench + self._random.standard_normal(wrench.shape) * self._noise_std
        volts = self._coded(self._calibration.volts(felt, self._unloaded_V))
        if (temperature := self._calibration.temperature) is not None:
            volts = np.column_stack([volts, np.full(len(volts), temperature.reference_V)])
        self._store.add(GageBlock(self._taken, volts), round(self._settings.store_s * self._settings.sampling_Hz))
        self._taken += len(wrench)

    def _coded(self, volts: Floats) -> Floats:
        """As a 16 bit converter between the rails gives them; beyond the rails it gives its first or last code."""
        lowest_V, highest_V = self._calibration.rails_V
        step_V = (highest_V - lowest_V) / CODES
        codes = np.clip(np.rint((volts - lowest_V) / step_V), 0, CODES - 1)
        coded: Floats = lowest_V + step_V * codes
        return coded
