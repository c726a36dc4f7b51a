"""Twin of an ATI DAQ F/T on a sampling card."""

from collections import deque
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from rfca_rig.devices.ati_daq.codec import GAGES, GageBlock, TransducerCalibration
from rfca_rig.devices.ati_daq.section import AtiDaqSection
from rfca_rig.twins.wires import SampleGrid

Floats = NDArray[np.float64]

CODES = 1 << 16


@dataclass(frozen=True)
class DaqFtTwinSettings:
    """Sample rate and buffer of the card, unloaded voltages, and noise standard deviation per axis
    in N and N m.

    If the buffer is not read within `store_s`, it overflows and the oldest samples are lost.
    """

    sampling_Hz: float = 15_000.0
    unloaded_V: tuple[float, ...] = (0.0,) * GAGES
    noise_std: tuple[float, ...] = (0.0,) * GAGES
    store_s: float = 2.0


@dataclass
class _Store:
    """Sample buffer of the card: blocks, and the number of samples in them."""

    blocks: deque[GageBlock] = field(default_factory=deque)
    held: int = 0

    def add(self, block: GageBlock, room: int) -> None:
        self.blocks.append(block)
        self.held += len(block.volts)
        # Whole blocks are dropped, oldest first; the driver sees the gap in the sample counter.
        while self.held > room:
            self.held -= len(self.blocks.popleft().volts)


class DaqFtTwin:
    """Implements `GageVoltages`, so a driver reads from it directly. A world advances it in
    steps: `due`, then `take_wrench`.
    """

    def __init__(
        self,
        calibration: TransducerCalibration,
        settings: DaqFtTwinSettings,
        random: np.random.Generator,
    ) -> None:
        self._calibration = calibration
        self._settings = settings
        self._random = random
        self._ticks = SampleGrid(1.0 / settings.sampling_Hz)
        self._unloaded_V = np.array(settings.unloaded_V)
        self._noise_std = np.array(settings.noise_std)
        self._running = False
        self._taken = 0
        self._store = _Store()

    def start(self) -> float:
        """Restarts the sample counter at 0; returns the sample rate in Hz."""
        self._running = True
        self._taken = 0
        self._store = _Store()
        return self._settings.sampling_Hz

    def stop(self) -> None:
        self._running = False

    def read(self) -> list[GageBlock]:
        """Blocks of voltages (m, channels) sampled since the last call."""
        blocks = list(self._store.blocks)
        self._store = _Store()
        return blocks

    def identity(self) -> dict[str, str]:
        return {"card": "twin, 16 bit", "card_rate_Hz": f"{self._settings.sampling_Hz:.6g}"}

    def take_requests(self) -> None:
        """Does nothing: a card reacts to calls at once."""

    def due(self, to_s: float) -> Floats:
        """Sample times (m,) in s in the step that ends at `to_s`; none while the card is
        stopped.
        """
        times_s = self._ticks.until(to_s)
        if self._running:
            return times_s
        return times_s[:0]

    def take_wrench(self, wrench: Floats) -> None:
        """Takes the true wrench (m, 6), in N and N m, at the times that were due."""
        if not len(wrench):
            return
        noisy = wrench + self._random.standard_normal(wrench.shape) * self._noise_std
        volts = self._digitise(self._calibration.volts(noisy, self._unloaded_V))
        if (temperature := self._calibration.temperature) is not None:
            # The thermistor shows the reference temperature, at which no compensation is needed.
            volts = np.column_stack([volts, np.full(len(volts), temperature.reference_V)])
        self._store.add(
            GageBlock(self._taken, volts),
            round(self._settings.store_s * self._settings.sampling_Hz),
        )
        self._taken += len(wrench)

    def _digitise(self, volts: Floats) -> Floats:
        """Quantises voltages (m, 6) to a 16 bit converter between the rails; beyond them it
        gives its first or last code.
        """
        lowest_V, highest_V = self._calibration.rails_V
        step_V = (highest_V - lowest_V) / CODES
        codes = np.clip(np.rint((volts - lowest_V) / step_V), 0, CODES - 1)
        coded: Floats = lowest_V + step_V * codes
        return coded


def make_twin(
    _wire: None, keys: AtiDaqSection, noise_std: tuple[float, ...], random: np.random.Generator
) -> DaqFtTwin:
    """The twin of the card that [force_sensor] names. Raises BadInput for a calibration file
    that cannot be used.
    """
    return DaqFtTwin(
        keys.calibration(), DaqFtTwinSettings(keys.rate_Hz, keys.unloaded_V, noise_std), random
    )
