"""Driver for an ATI DAQ F/T: gage voltages from a sampling card, forces by the transducer's
calibration.
"""

from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from rfca_rig.clock import Clock
from rfca_rig.codecs.force_sensors import SATURATED
from rfca_rig.devices.ati_daq.codec import GAGES, GageBlock, TransducerCalibration
from rfca_rig.devices.ati_daq.section import AtiDaqSection
from rfca_rig.drivers.reading_check import ReadingCheck, Signal, describe_bad
from rfca_rig.drivers.record_stream import FrozenRecordCounter, RecordSequence, StatusCounter
from rfca_rig.drivers.roles import ForceSamples, SensorScale, StreamHealth
from rfca_rig.errors import BadInput, DeviceError

Floats = NDArray[np.float64]

# Per N and N m: a thousandth of the resolution of a 16 bit card, so the voltages can be recovered
# from the counts.
COUNTS_PER_UNIT = 1e6
MAX_COUNT = 2**31 - 1
# Cards measure up to 10 V; the sum over all channels of a sample is checked.
VOLTAGE = Signal("voltage", "V", -1e3, 1e3)
# The card's clock cannot give every rate exactly; a difference of 1 % from the settings is
# accepted.
RATE_TOLERANCE = 1e-2
# Share of the span that counts as the rail: one code of a 16 bit converter at each end.
RAIL_SLACK = 2.0**-15
# Averaging time of a bias and the limit for it, in s.
BIAS_S = 0.2
BIAS_TIMEOUT_S = 2.0

# Length of the card's sample buffer in s; it must outlast any pause between two reads.
STORE_S = 2.0


class GageVoltages(Protocol):
    """Source of gage voltages, on the card's own clock: six differential inputs, and a seventh
    for a thermistor if calibrated.
    """

    def start(self) -> float:
        """Restarts sampling; returns the true sample rate of the card's clock in Hz.

        Raises DeviceError if the card is missing or refuses.
        """
        ...

    def read(self) -> list[GageBlock]:
        """Blocks of voltages (m, channels) since the last call; never waits. Raises DeviceError
        if the card stopped.
        """
        ...

    def stop(self) -> None:
        """Ends sampling. May be called at any time, any number of times."""
        ...

    def identity(self) -> dict[str, str]: ...


@dataclass(frozen=True)
class DaqFtSettings:
    """Sample rate, and the voltages of the unloaded transducer, with the thermistor's last if there
    is one.

    Raises BadInput for a rate that is not above 0.
    """

    rate_Hz: float
    unloaded_V: tuple[float, ...] = (0.0,) * GAGES

    def __post_init__(self) -> None:
        if not 0.0 < self.rate_Hz < float("inf"):
            raise BadInput(f"force sensor: rate_Hz is {self.rate_Hz}, must be above 0")


class DaqFtSensor:
    """A `ForceSensor` over gage voltages. Time is the card's sample counter; samples are read in
    blocks.

    Raises BadInput if the settings do not match the calibration.
    """

    def __init__(
        self,
        gages: GageVoltages,
        clock: Clock,
        calibration: TransducerCalibration,
        settings: DaqFtSettings,
    ) -> None:
        if len(settings.unloaded_V) != calibration.channels:
            raise BadInput(
                f"force sensor: unloaded_V holds {len(settings.unloaded_V)} voltages, the "
                f"calibration needs {calibration.channels}"
            )
        self._gages = gages
        self._clock = clock
        self._calibration = calibration
        self._settings = settings
        self._unloaded_V = np.array(settings.unloaded_V)
        self._rate_Hz = settings.rate_Hz
        self._running = False
        self._reset()

    def _reset(self) -> None:
        self._sequence = RecordSequence(first=1)
        self._status = StatusCounter()
        self._frozen = FrozenRecordCounter()
        self._malformed = 0
        self._check = ReadingCheck("the force sensor", VOLTAGE)
        self._heard_s = self._read_s = self._clock.now_s()

    def start(self) -> None:
        """Starts the card. Raises DeviceError if its clock gives another rate, which would
        stretch the time base.
        """
        self._gages.stop()
        self._reset()
        self._rate_Hz = self._gages.start()
        if abs(self._rate_Hz / self._settings.rate_Hz - 1.0) > RATE_TOLERANCE:
            self._gages.stop()
            raise DeviceError(
                f"force sensor: rate_Hz is {self._settings.rate_Hz:g}, the card's clock "
                f"gives {self._rate_Hz:.6g}; set that one"
            )
        self._running = True

    def stop(self) -> None:
        self._running = False
        self._gages.stop()

    def bias(self) -> None:
        """Takes the mean voltages of the next 0.2 s as those without load; call it with the sensor
        unloaded.

        Raises DeviceError if none arrive. Restarts a running stream.
        """
        was_running = self._running
        self.start()
        blocks: list[GageBlock] = []
        deadline_s = self._clock.now_s() + BIAS_TIMEOUT_S
        while sum(len(block.volts) for block in blocks) < BIAS_S * self._rate_Hz:
            if self._clock.now_s() > deadline_s:
                self.stop()
                raise DeviceError(
                    f"the card gave too few samples for a bias within {BIAS_TIMEOUT_S:g} "
                    "s; check its sample clock"
                )
            self._clock.wait_until(self._clock.now_s() + 0.1 * BIAS_S)
            blocks += self._valid_blocks(self._gages.read())
        mean: Floats = np.concatenate([block.volts for block in blocks]).mean(axis=0)
        self._unloaded_V = mean
        self.stop()
        if was_running:
            self.start()

    def read(self) -> ForceSamples:
        """Records (m, 6) since the last call, ascending, each once. Raises DeviceError if the
        card stopped.
        """
        self._read_s = self._clock.now_s()
        if not self._running:
            return self._samples(np.empty((0, self._calibration.channels)), np.empty(0, np.int64))
        blocks = self._valid_blocks(self._gages.read())
        if not blocks:
            return self._samples(np.empty((0, self._calibration.channels)), np.empty(0, np.int64))
        # Record numbers start at 1, sample counters of the card at 0.
        counters = [
            np.arange(block.first + 1, block.first + 1 + len(block.volts)) for block in blocks
        ]
        picked, numbers = self._sequence.take(
            (np.concatenate(counters) & 0xFFFFFFFF).astype(np.uint32)
        )
        return self._samples(np.concatenate([block.volts for block in blocks])[picked], numbers)

    def _valid_blocks(self, blocks: list[GageBlock]) -> list[GageBlock]:
        """Blocks (m, channels) that have every channel, others count as malformed; of those, the
        samples with finite voltages.

        Raises BadReading at the third sample in a row that has one that is not finite.
        """
        channels = self._calibration.channels
        whole = [
            block for block in blocks if block.volts.ndim == 2 and block.volts.shape[1] == channels
        ]
        self._malformed += len(blocks) - len(whole)
        return [valid for block in whole for valid in self._finite_parts(block) if len(valid.volts)]

    def _finite_parts(self, block: GageBlock) -> list[GageBlock]:
        """The block without the samples that are not finite, in as many parts as they leave."""
        if np.isfinite(block.volts).all():
            self._check.accept(0.0)
            return [block]
        parts = []
        begin = 0
        for index, volts in enumerate(block.volts):
            # Any value of a sample that is not finite makes the sum so.
            if not self._check.accept(float(volts.sum())):
                parts.append(GageBlock(block.first + begin, block.volts[begin:index]))
                begin = index + 1
        return [*parts, GageBlock(block.first + begin, block.volts[begin:])]

    def _samples(self, volts: Floats, numbers: NDArray[np.int64]) -> ForceSamples:
        lowest_V, highest_V = self._calibration.rails_V
        slack_V = RAIL_SLACK * (highest_V - lowest_V)
        gages = volts[:, :GAGES]
        # A clipped voltage makes all six forces wrong, as each depends on all gages.
        outside = (gages <= lowest_V + slack_V) | (gages >= highest_V - slack_V)
        status = np.where(outside.any(axis=1), np.uint32(SATURATED), np.uint32(0)).astype(np.uint32)
        if len(numbers):
            self._heard_s = self._read_s
            self._status.take(status)
            self._frozen.take(volts)
        counts = np.rint(self._calibration.wrench(volts, self._unloaded_V) * COUNTS_PER_UNIT)
        return ForceSamples(
            host_s=np.full(len(numbers), self._read_s),
            device_s=(numbers - 1) / self._rate_Hz,
            sequence=numbers,
            status=status,
            # A force that is no number counts as the largest, which trips.
            counts=np.clip(np.nan_to_num(counts, nan=MAX_COUNT), -MAX_COUNT, MAX_COUNT).astype(
                np.int32
            ),
        )

    def silent_s(self) -> float:
        """Time in s from the last `read` with a record, or from the start, to the last `read`."""
        return self._read_s - self._heard_s

    def scale(self) -> SensorScale:
        return SensorScale(COUNTS_PER_UNIT, COUNTS_PER_UNIT, self._settings.rate_Hz)

    def health(self) -> StreamHealth:
        """Counters since `start`."""
        malformed = self._malformed + sum(self._check.bad.values())
        return self._sequence.health(self._status, self._frozen.frozen, malformed, self._notes())

    def _notes(self) -> list[str]:
        notes = []
        if self._running and self.silent_s() > 0.1:
            notes.append(
                f"no sample for {self.silent_s():.2f} s: check the card and its sample clock"
            )
        if self._frozen.frozen:
            notes.append(
                f"all gage voltages stood still over {self._frozen.frozen} samples: is "
                "the transducer connected?"
            )
        if self._status.saturated:
            notes.append(
                f"a gage voltage at the rail in {self._status.saturated} samples: "
                "overload, or a broken wire"
            )
        if self._sequence.lost:
            notes.append("the card's store ran over: this computer was too busy to empty it")
        if self._malformed:
            notes.append(
                f"{self._malformed} blocks thrown away: not {self._calibration.channels} "
                "voltages a sample"
            )
        if self._check.bad:
            notes.append(
                f"samples with impossible voltages were refused: {describe_bad(self._check.bad)}"
            )
        return notes

    def identity(self) -> dict[str, str]:
        """For the recording. Matrix and unloaded voltages are included, so the voltages can be
        recovered from a recording.
        """
        calibration = self._calibration
        return {
            "make": f"ATI DAQ F/T {calibration.body_style} {calibration.part_number}".replace(
                "  ", " "
            ),
            "serial_number": calibration.serial_number,
            "calibration_date": calibration.date,
            "matrix_SI_per_V": repr(calibration.matrix.tolist()),
            "unloaded_V": repr(self._unloaded_V.tolist()),
            "counts_per_N": repr(COUNTS_PER_UNIT),
            "counts_per_Nm": repr(COUNTS_PER_UNIT),
            "rate_Hz": f"{self._rate_Hz:.9g}",
            **self._gages.identity(),
        }


class NidaqmxGages:
    """`GageVoltages` with a continuous, hardware-timed task over differential inputs, gages first,
    thermistor last.

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
        """Starts the task; returns the true sample rate in Hz. Raises DeviceError if card,
        channels or driver are missing.
        """
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
            # The card rounds the requested rate to what its clock can divide, so the true one is
            # read back.
            return float(task.timing.samp_clk_rate)
        except ni.errors.Error as error:
            self.stop()
            raise DeviceError(
                f"card {self._channels} does not start: {_describe_error(error)}; check "
                "[force_sensor] channels"
            ) from error

    def read(self) -> list[GageBlock]:
        """Blocks of voltages (m, channels) since the last call. Raises DeviceError if the card
        stopped, as on a buffer overflow.
        """
        if self._task is None:
            return []
        try:
            waiting = int(self._task.in_stream.avail_samp_per_chan)
            if not waiting:
                return []
            columns = np.empty((self._task.number_of_channels, waiting))
            self._ni.stream_readers.AnalogMultiChannelReader(self._task.in_stream).read_many_sample(
                columns, waiting, timeout=0.0
            )
        except self._ni.errors.Error as error:
            raise DeviceError(
                f"card {self._channels} stopped sampling: {_describe_error(error)}"
            ) from error
        block = GageBlock(self._taken, columns.T)
        self._taken += len(block.volts)
        return [block]

    def stop(self) -> None:
        if self._task is not None:
            self._task.close()
            self._task = None

    close = stop

    def identity(self) -> dict[str, str]:
        return {
            "card": f"NI, {self._channels}",
            "card_range_V": f"{self._rails_V[0]:g} to {self._rails_V[1]:g}",
        }


def _nidaqmx() -> Any:
    """Imports the package and its submodules; raises BadInput if they are not installed."""
    try:
        import nidaqmx  # noqa: PLC0415 (an extra, with a driver that few machines have)
        import nidaqmx.constants  # noqa: PLC0415
        import nidaqmx.errors  # noqa: PLC0415
        import nidaqmx.stream_readers  # noqa: PLC0415
    except ImportError:
        raise BadInput(
            'the device ati-daq needs NI\'s package: pip install "rfca-rig[daq]", and '
            "the NI-DAQmx driver from ni.com"
        ) from None
    return nidaqmx


def _describe_error(error: Exception) -> str:
    return " ".join(str(error).split())[:200]


def open_card(keys: AtiDaqSection, clock: Clock) -> NidaqmxGages:  # noqa: ARG001 (the card has its own clock)
    """The card that [force_sensor] names. Raises BadInput without NI's package, and for an
    unusable calibration file.
    """
    return NidaqmxGages(keys.channels, keys.rate_Hz, keys.calibration().rails_V)


def make_driver(keys: AtiDaqSection, gages: GageVoltages, clock: Clock) -> DaqFtSensor:
    """The driver of the transducer that [force_sensor] names."""
    return DaqFtSensor(gages, clock, keys.calibration(), keys.to_dataclass(DaqFtSettings))
