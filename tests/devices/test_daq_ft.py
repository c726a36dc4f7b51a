"""The DAQ F/T driver on its twin, and its adapter for National Instruments' package on a
stand-in for that package.
"""

import json
import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import ClassVar

import numpy as np
import pytest

from rfca_rig.clock import TwinClock
from rfca_rig.contracts.force_sensor import ForceSensorContract, ForceSensorRig, constant
from rfca_rig.devices.ati_daq.codec import (
    GageBlock,
    TemperatureCompensation,
    TransducerCalibration,
    parse_calibration,
)
from rfca_rig.devices.ati_daq.driver import (
    COUNTS_PER_UNIT,
    DaqFtSensor,
    DaqFtSettings,
    NidaqmxGages,
)
from rfca_rig.devices.ati_daq.twin import DaqFtTwin, DaqFtTwinSettings
from rfca_rig.drivers.record_stream import FrozenRecordCounter
from rfca_rig.errors import BadInput, BadReading, DeviceError

ROOT = Path(__file__).parents[2]
CAL = ROOT / "calibration" / "made-up-gamma.cal"
UNLOADED_V = (0.31, -0.22, 0.05, -0.4, 0.18, 0.02)
HALF_CODE_V = 0.5 * 20.0 / 2**16


def calibration() -> TransducerCalibration:
    return parse_calibration(CAL.read_bytes(), "made-up-gamma.cal")


Change = Callable[[list[GageBlock]], list[GageBlock]]


@dataclass
class TamperedGages:
    """Voltages on their way to the driver, through which a test can lose, double, reorder and
    damage them.
    """

    twin: DaqFtTwin
    tamper: Change | None = None

    def start(self) -> float:
        return self.twin.start()

    def read(self) -> list[GageBlock]:
        blocks = self.twin.read()
        if self.tamper:
            return self.tamper(blocks)
        return blocks

    def stop(self) -> None:
        self.twin.stop()

    def identity(self) -> dict[str, str]:
        return self.twin.identity()

    def once(self, change: Change) -> Callable[[], None]:
        """Changes what is read next."""

        def tamper(blocks: list[GageBlock]) -> list[GageBlock]:
            if not blocks:
                return blocks
            self.tamper = None
            return change(blocks)

        return lambda: setattr(self, "tamper", tamper)

    def from_now(self, change: Change) -> Callable[[], None]:
        return lambda: setattr(self, "tamper", change)


def made(
    rate_Hz: float = 15_000.0,
    twin: DaqFtTwinSettings | None = None,
    settings: DaqFtSettings | None = None,
) -> ForceSensorRig:
    cal = calibration()
    clock = TwinClock()
    daq_twin = DaqFtTwin(
        cal, twin or DaqFtTwinSettings(rate_Hz, UNLOADED_V), np.random.default_rng(1)
    )
    gages = TamperedGages(daq_twin)
    sensor = DaqFtSensor(gages, clock, cal, settings or DaqFtSettings(rate_Hz, UNLOADED_V))
    return ForceSensorRig(
        clock=clock,
        sensor=sensor,
        twin=daq_twin,
        rate_Hz=rate_Hz,
        latency_s=0.0,
        resolution=np.abs(cal.matrix).sum(axis=1) * HALF_CODE_V + 1e-6,
        saturating=(0.0, 0.0, 2400.0, 0.0, 0.0, 0.0),
        silence=gages.from_now(lambda _: []),
        lose=gages.once(lambda blocks: blocks[1:]),
        damage=gages.once(
            lambda blocks: [GageBlock(blocks[0].first, blocks[0].volts[:, :5]), *blocks[1:]]
        ),
        freeze=gages.from_now(
            lambda blocks: [
                GageBlock(block.first, np.full_like(block.volts, 0.1)) for block in blocks
            ]
        ),
        repeat=gages.once(lambda blocks: [blocks[0], *blocks]),
        swap=gages.once(halves_swapped),
    )


def halves_swapped(blocks: list[GageBlock]) -> list[GageBlock]:
    first = blocks[0].first
    volts = blocks[0].volts
    middle = len(volts) // 2
    return [
        GageBlock(first + middle, volts[middle:]),
        GageBlock(first, volts[:middle]),
        *blocks[1:],
    ]


class TestDaqFt(ForceSensorContract):
    @pytest.fixture
    def rig(self) -> ForceSensorRig:
        return made()


def test_voltages_can_be_had_back_from_counts_matrix_and_unloaded_voltages() -> None:
    rig = made()
    rig.sensor.start()
    samples = rig.run(0.1)
    identity = rig.sensor.identity()
    matrix = np.array(json.loads(identity["matrix_SI_per_V"]))
    unloaded_V = np.array(json.loads(identity["unloaded_V"]))
    volts = np.linalg.solve(matrix, (samples.counts / COUNTS_PER_UNIT).T).T + unloaded_V
    codes = (volts + 10.0) / (2.0 * HALF_CODE_V)
    assert np.abs(codes - np.rint(codes)).max() < 0.01


def test_values_stay_with_their_samples_when_put_in_order() -> None:
    plain = made()
    swapped = made()
    for rig in (plain, swapped):
        rig.sensor.start()
        rig.run(0.1)
    swapped.swap()
    assert swapped.run(0.1).counts.tolist() == plain.run(0.1).counts.tolist()


def test_the_twins_converter_ends_at_its_rails() -> None:
    rig = made()
    for sign, rail_V in ((1.0, 10.0 - 2.0 * HALF_CODE_V), (-1.0, -10.0)):
        rig.wrench = constant(0.0, 0.0, sign * 1e5, 0.0, 0.0, 0.0)
        rig.sensor.start()
        rig.clock.wait_until(rig.clock.now_s() + 0.01)
        (block, *_) = rig.twin.read()
        gages = block.volts[0, [0, 2, 4]]
        assert gages == pytest.approx([rail_V] * 3)


def test_fifty_equal_samples_in_a_row_are_frozen_and_one_less_are_not() -> None:
    for length, frozen in ((50, 0), (51, 50), (60, 59)):
        count = FrozenRecordCounter()
        count.take(np.arange(12.0).reshape(2, 6))
        for _ in range(length):
            count.take(np.ones((1, 6)))
        count.take(np.arange(12.0).reshape(2, 6))
        assert count.frozen == frozen


@pytest.mark.parametrize(("length", "frozen"), [(50, 0), (51, 50)])
def test_the_first_sample_repeats_none(length: int, frozen: int) -> None:
    count = FrozenRecordCounter()
    count.take(np.ones((length, 6)))
    assert count.frozen == frozen


def test_a_bias_takes_what_is_felt_now_for_no_load() -> None:
    rig = made(settings=DaqFtSettings(15_000.0))
    rig.wrench = constant(0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    rig.sensor.start()
    assert np.abs(rig.in_units(rig.run(0.1))).max() > 1.0
    rig.sensor.bias()
    rig.wrench = constant(1.0, 2.0, 3.0, 0.1, 0.2, 0.3)
    measured = rig.in_units(rig.run(0.1))
    assert len(measured) > 100
    assert np.all(
        np.abs(measured - np.array([1.0, 2.0, 3.0, 0.1, 0.2, 0.3])) <= 2.0 * rig.resolution
    )


def test_a_card_that_gives_nothing_ends_a_bias_with_a_line() -> None:
    rig = made()
    rig.silence()
    with pytest.raises(DeviceError, match="too few samples for a bias"):
        rig.sensor.bias()


def test_a_card_with_another_clock_is_refused_with_both_rates() -> None:
    rig = made(twin=DaqFtTwinSettings(14_000.0), settings=DaqFtSettings(15_000.0))
    with pytest.raises(DeviceError, match=r"rate_Hz is 15000, the card's clock gives 14000"):
        rig.sensor.start()
    assert len(rig.sensor.read().sequence) == 0


def test_time_is_by_the_cards_true_clock_where_it_is_close() -> None:
    rig = made(twin=DaqFtTwinSettings(15_015.015), settings=DaqFtSettings(15_000.0))
    rig.sensor.start()
    samples = rig.run(1.0)
    assert samples.device_s[-1] == pytest.approx((samples.sequence[-1] - 1) / 15_015.015)


def test_a_store_that_nobody_empties_runs_over_and_is_counted() -> None:
    rig = made()
    rig.sensor.start()
    rig.run(0.1)
    rig.clock.wait_until(rig.clock.now_s() + 3.0)
    samples = rig.run(0.1)
    health = rig.sensor.health()
    assert health.lost == pytest.approx(15_000, rel=0.01)
    assert samples.device_s[-1] == pytest.approx(3.2, abs=0.01)
    assert any("store ran over" in note for note in health.notes)


def test_voltages_other_than_the_calibration_needs_are_refused() -> None:
    with pytest.raises(BadInput, match="unloaded_V holds 3 voltages, the calibration needs 6"):
        made(settings=DaqFtSettings(15_000.0, (0.0, 0.0, 0.0)))


@pytest.mark.parametrize("rate_Hz", [0.0, -1.0, float("nan"), float("inf")])
def test_a_rate_that_cannot_be_is_refused(rate_Hz: float) -> None:
    with pytest.raises(BadInput, match="rate_Hz is"):
        DaqFtSettings(rate_Hz)


def spoil(samples: int, value: float) -> Callable[[list[GageBlock]], list[GageBlock]]:
    """The first samples of every block have a gage voltage that is no number."""

    def tamper(blocks: list[GageBlock]) -> list[GageBlock]:
        for block in blocks:
            block.volts[:samples, 2] = value
        return blocks

    return tamper


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
def test_samples_that_are_no_numbers_are_dropped_and_three_in_a_row_are_an_error(
    value: float,
) -> None:
    rig = made()
    rig.sensor.start()
    rig.sensor._gages.tamper = spoil(2, value)
    kept = rig.run(0.01)
    assert rig.sensor.health().malformed > 0
    assert np.abs(kept.counts).max() < 1e9
    rig.sensor._gages.tamper = spoil(3, value)
    with pytest.raises(BadReading, match="the force sensor reports voltage"):
        rig.run(0.01)


def test_a_thermistor_takes_the_warmth_out_of_the_wrench() -> None:
    cold = calibration()
    temperature = TemperatureCompensation(np.full(6, 0.1), np.full(6, 0.02), 2.5)
    warm = TransducerCalibration(**{**vars(cold), "temperature": temperature})
    wrench = np.array([[10.0, 20.0, -30.0, 1.0, 2.0, 3.0]])
    at_reference = cold.volts(wrench, np.array(UNLOADED_V))
    dt_V = 0.3
    warmed = at_reference * (1.0 - 0.02 * dt_V) - 0.1 * dt_V
    unloaded = np.array([*UNLOADED_V, 2.5])
    felt = warm.wrench(np.column_stack([warmed, [2.5 + dt_V]]), unloaded)
    assert felt == pytest.approx(wrench, abs=1e-9)
    assert cold.wrench(warmed, np.array(UNLOADED_V)) != pytest.approx(wrench, abs=0.5)


class StandInTask:
    """Of `nidaqmx.Task` what the adapter uses."""

    made: ClassVar[list["StandInTask"]] = []
    waiting: ClassVar[list[np.ndarray]] = []
    refuses: Exception | None = None

    def __init__(self) -> None:
        if self.refuses:
            raise self.refuses
        self.channels: dict[str, object] = {}
        self.clock: dict[str, object] = {}
        self.closed = self.started = False
        self.number_of_channels = 6
        self.ai_channels = SimpleNamespace(
            add_ai_voltage_chan=lambda name, **how: self.channels.update(name=name, **how)
        )
        self.timing = SimpleNamespace(
            cfg_samp_clk_timing=lambda rate, **how: self.clock.update(rate=rate, **how),
            samp_clk_rate=15_000.94,
        )
        StandInTask.made.append(self)

    @property
    def in_stream(self) -> "StandInTask":
        return self

    @property
    def avail_samp_per_chan(self) -> int:
        return sum(volts.shape[1] for volts in self.waiting)

    def start(self) -> None:
        self.started = True

    def close(self) -> None:
        self.closed = True


class StandInReader:
    def __init__(self, stream: StandInTask) -> None:
        self.stream = stream

    def read_many_sample(self, data: np.ndarray, count: int, timeout: float) -> int:
        assert timeout == 0.0
        data[:] = np.concatenate(self.stream.waiting, axis=1)[:, :count]
        self.stream.waiting.clear()
        return count


@pytest.fixture
def ni(monkeypatch: pytest.MonkeyPatch) -> type[StandInTask]:
    package = ModuleType("nidaqmx")
    package.Task = StandInTask
    package.constants = SimpleNamespace(
        TerminalConfiguration=SimpleNamespace(DIFF="differential"),
        AcquisitionType=SimpleNamespace(CONTINUOUS="continuous"),
    )
    package.errors = SimpleNamespace(Error=type("Error", (Exception,), {}))
    package.stream_readers = SimpleNamespace(AnalogMultiChannelReader=StandInReader)
    for name in ("", ".constants", ".errors", ".stream_readers"):
        monkeypatch.setitem(
            sys.modules, f"nidaqmx{name}", getattr(package, name[1:]) if name else package
        )
    monkeypatch.setattr(StandInTask, "made", [])
    monkeypatch.setattr(StandInTask, "waiting", [])
    monkeypatch.setattr(StandInTask, "refuses", None)
    return StandInTask


def test_the_card_is_asked_for_differential_inputs_on_its_own_clock(ni: type[StandInTask]) -> None:
    gages = NidaqmxGages("Dev1/ai0:5", 15_000.0, (-10.0, 10.0))
    assert gages.start() == 15_000.94
    (task,) = ni.made
    assert task.channels == {
        "name": "Dev1/ai0:5",
        "terminal_config": "differential",
        "min_val": -10.0,
        "max_val": 10.0,
    }
    assert task.clock == {"rate": 15_000.0, "sample_mode": "continuous", "samps_per_chan": 30_000}
    assert task.started
    gages.stop()
    gages.stop()
    assert task.closed
    assert gages.read() == []


def test_the_cards_samples_are_numbered_from_the_start(ni: type[StandInTask]) -> None:
    gages = NidaqmxGages("Dev1/ai0:5", 15_000.0, (-10.0, 10.0))
    gages.start()
    assert gages.read() == []
    ni.waiting += [np.arange(12.0).reshape(6, 2), np.arange(6.0).reshape(6, 1)]
    (first,) = gages.read()
    ni.waiting += [np.ones((6, 4))]
    (second,) = gages.read()
    assert (first.first, first.volts.shape, second.first, second.volts.shape) == (
        0,
        (3, 6),
        3,
        (4, 6),
    )
    assert first.volts[1].tolist() == [1.0, 3.0, 5.0, 7.0, 9.0, 11.0]


def test_a_card_that_refuses_is_told_in_its_own_words_on_one_line(ni: type[StandInTask]) -> None:
    gages = NidaqmxGages("Dev9/ai0:5", 15_000.0, (-10.0, 10.0))
    ni.refuses = sys.modules["nidaqmx"].errors.Error(
        "Device identifier is invalid.\n\nDevice Specified: Dev9"
    )
    with pytest.raises(
        DeviceError,
        match=(
            r"card Dev9/ai0:5 does not start: Device identifier is invalid\. Device "
            r"Specified: Dev9"
        ),
    ):
        gages.start()


def test_without_the_package_one_line_says_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "nidaqmx", None)
    with pytest.raises(BadInput, match=r'pip install "rfca-rig\[daq\]"'):
        NidaqmxGages("Dev1/ai0:5", 15_000.0, (-10.0, 10.0))
