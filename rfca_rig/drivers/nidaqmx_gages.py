"""Gage voltages from a National Instruments card, through NI's package `nidaqmx` (optional; needs NI's driver)."""

from typing import Any

import numpy as np

from rfca_rig.codecs.gage_block import GageBlock
from rfca_rig.errors import BadInput, DeviceError

# Length of the card's sample buffer in s; it must outlast any pause between two reads.
STORE_S = 2.0


class NidaqmxGages:
    """`GageVoltages` with a continuous, hardware-timed task over differential inputs, gages first, thermistor last.

    Raises BadInput if `nidaqmx` is not installed.
    """

    def __init__(self, channels: str, rate_Hz: float, rails_V: tuple[float, float]) -> None:
        """`channels` in NI's notation, for example Dev1/ai0:5; `rails_V` is the input range."""
        self._ni = _nidaqmx()
        self._channels = channels
        self._rate_Hz = rate_Hz
        self._rails_V = rails_V
        self._task: Any = None
        self._taken = 0

    def start(self) -> float:
        """Starts the task; returns the true sample rate in Hz. Raises DeviceError if card, channels or driver are missing."""
        self.stop()
        ni = self._ni
        try:
            self._task = task = ni.Task()
            task.ai_channels.add_ai_voltage_chan(
                self._channels,
                terminal_config=ni.constants.TerminalConfiguration.DIFF,
                min_val=self._rails_V[0],
                max_val=self._rails_V[1],
            )
            task.timing.cfg_samp_clk_timing(
                self._rate_Hz,
                sample_mode=ni.constants.AcquisitionType.CONTINUOUS,
                samps_per_chan=round(STORE_S * self._rate_Hz),
            )
            task.start()
            self._taken = 0
            # The card rounds the requested rate to what its clock can divide, so the true one is read back.
            return float(task.timing.samp_clk_rate)
        except ni.errors.Error as error:
            self.stop()
            raise DeviceError(f"card {self._channels} does not start: {_one_line(error)}; check [force_sensor] channels") from error

    def read(self) -> list[GageBlock]:
        """Blocks of voltages (m, channels) since the last call. Raises DeviceError if the card stopped, as on a buffer overflow."""
        if self._task is None:
            return []
        try:
            waiting = int(self._task.in_stream.avail_samp_per_chan)
            if not waiting:
                return []
            columns = np.empty((self._task.number_of_channels, waiting))
            self._ni.stream_readers.AnalogMultiChannelReader(self._task.in_stream).read_many_sample(columns, waiting, timeout=0.0)
        except self._ni.errors.Error as error:
            raise DeviceError(f"card {self._channels} stopped sampling: {_one_line(error)}") from error
        block = GageBlock(self._taken, columns.T)
        self._taken += len(block.volts)
        return [block]

    def stop(self) -> None:
        if self._task is not None:
            self._task.close()
            self._task = None

    def identity(self) -> dict[str, str]:
        return {"card": f"NI, {self._channels}", "card_range_V": f"{self._rails_V[0]:g} to {self._rails_V[1]:g}"}


def _nidaqmx() -> Any:
    """Imports the package and its submodules; raises BadInput if they are not installed."""
    try:
        import nidaqmx  # noqa: PLC0415 (an extra, with a driver that few machines have)
        import nidaqmx.constants  # noqa: PLC0415
        import nidaqmx.errors  # noqa: PLC0415
        import nidaqmx.stream_readers  # noqa: PLC0415
    except ImportError:
        raise BadInput('the device ati-daq needs NI\'s package: pip install "rfca-rig[daq]", and the NI-DAQmx driver from ni.com') from None
    return nidaqmx


def _one_line(error: Exception) -> str:
    return " ".join(str(error).split())[:200]
