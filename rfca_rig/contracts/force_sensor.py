"""Conformance tests for force sensors of any make, and their test rig; the test of each device
inherits them.

The rig has clock, driver, twin, and a prescribed wrench in place of a plant.
"""

from collections.abc import Callable
from dataclasses import dataclass, field
from math import ceil

import numpy as np
import pytest
from numpy.typing import NDArray

from rfca_rig.clock import TwinClock
from rfca_rig.drivers.roles import ForceSamples, ForceSensor, StreamHealth
from rfca_rig.twins.wires import HostEnd
from rfca_rig.twins.world import SensorTwin

# Period of the reading loop in s.
TICK_S = 2e-3

Floats = NDArray[np.float64]
Wrench = Callable[[Floats], Floats]
Tamper = Callable[[], None]

# Bits of the status word that are the same for every make, see `ForceSamples`.
ERROR = np.uint32(1 << 31)
SATURATED = np.uint32(1 << 17)

# Values of both signs, different on every axis, so that swapped axes show.
KNOWN_WRENCH = (3.0, -7.5, 12.25, 0.5, -0.75, 1.125)

# Bits to flip in a changed byte.
FLIPPED_BITS = 0x5A


def swinging(times_s: Floats) -> Floats:
    """Wrench (m, 6) at times (m,): amplitudes (1, 2, ... 6) / 2 N and N m at different
    frequencies, so that no two records are equal.
    """
    axes: Floats = np.arange(1.0, 7.0)
    return 0.5 * axes * np.sin(2.0 * np.pi * (3.0 + 0.7 * axes) * times_s[:, None])


def constant(*wrench: float) -> Wrench:
    """A wrench function that returns the same six values (m, 6) at all times (m,)."""
    return lambda times_s: np.tile(np.array(wrench), (len(times_s), 1))


@dataclass
class ForceSensorRig:
    """One sensor with its twin and its faults.

    `latency_s` is the largest delay of the newest record. `resolution` (6,) is one count of the
    device in N and N m, `time_step_s` one step of its clock if it reports time. `saturating` is a
    wrench beyond the range. Each fault starts when it is called; it is None if the wire cannot have
    it.
    """

    clock: TwinClock
    sensor: ForceSensor
    twin: SensorTwin
    rate_Hz: float
    latency_s: float
    resolution: Floats
    saturating: tuple[float, ...]
    silence: Tamper
    lose: Tamper
    damage: Tamper
    freeze: Tamper
    repeat: Tamper | None = None
    swap: Tamper | None = None
    wrench: Wrench = swinging
    time_step_s: float = 1e-9
    twin_s: float = 0.0
    blocks: list[ForceSamples] = field(default_factory=list)

    def __post_init__(self) -> None:
        self.clock.carry(self._carry)

    def _carry(self, to_s: float) -> None:
        """Advances the twin under the present wrench, in steps of at most one tick."""
        began_s = self.twin_s
        steps = max(1, ceil((to_s - began_s) / TICK_S - 1e-6))
        for step in range(1, steps + 1):
            end_s = to_s if step == steps else began_s + step * TICK_S
            self.twin.take_requests()
            due_s = self.twin.due(end_s)
            # The reshape keeps the shape (0, 6) if no sample was due.
            self.twin.take_wrench(self.wrench(due_s).reshape(-1, 6))
        self.twin_s = to_s

    def run(self, seconds: float) -> ForceSamples:
        """Reads at every tick, as a control loop does; returns all records (m, 6) of that time."""
        read = []
        for _ in range(round(seconds / TICK_S)):
            self.clock.wait_until(self.clock.now_s() + TICK_S)
            read.append(self.sensor.read())
        self.blocks += read
        return concatenate_samples(read)

    def in_units(self, samples: ForceSamples) -> Floats:
        """Wrench (m, 6) in N and N m from counts (m, 6)."""
        scale = self.sensor.scale()
        in_units: Floats = samples.counts / np.repeat([scale.counts_per_N, scale.counts_per_Nm], 3)
        return in_units


def concatenate_samples(blocks: list[ForceSamples]) -> ForceSamples:
    """Concatenates blocks of records along the first axis, columns (m,) and (m, 6)."""
    columns = {}
    for name in vars(blocks[0]):
        columns[name] = np.concatenate([vars(block)[name] for block in blocks])
    return ForceSamples(**columns)


class ForceSensorContract:
    """Inherit, and provide the device in the fixture `rig`."""

    @pytest.fixture
    def rig(self) -> ForceSensorRig:
        raise NotImplementedError

    def test_streams_at_its_rate_and_numbers_every_record(self, rig: ForceSensorRig) -> None:
        rig.sensor.start()
        samples = rig.run(2.0)
        assert rig.sensor.scale().rate_Hz == pytest.approx(rig.rate_Hz)
        # Two records of tolerance: the stream starts and ends between two records.
        assert (
            (2.0 - rig.latency_s) * rig.rate_Hz - 2
            <= len(samples.sequence)
            <= 2.0 * rig.rate_Hz + 2
        )
        assert samples.sequence.tolist() == list(range(1, len(samples.sequence) + 1))

    def test_time_is_counted_from_the_first_record(self, rig: ForceSensorRig) -> None:
        rig.sensor.start()
        samples = rig.run(1.0)
        assert samples.device_s == pytest.approx(
            (samples.sequence - 1) / rig.rate_Hz, abs=rig.time_step_s
        )
        assert np.all(np.diff(samples.host_s) >= 0.0)
        # Two record periods and two ticks of the reading loop, besides the latency.
        assert np.ptp(samples.host_s - samples.device_s) < rig.latency_s + 2.0 / rig.rate_Hz + 4e-3

    def test_shapes_and_types_are_those_of_the_role(self, rig: ForceSensorRig) -> None:
        rig.sensor.start()
        for samples in (rig.sensor.read(), rig.run(0.5)):
            rows = len(samples.sequence)
            assert samples.counts.shape == (rows, 6)
            assert samples.host_s.shape == samples.device_s.shape == samples.status.shape == (rows,)
            assert samples.counts.dtype == np.int32
            assert samples.status.dtype == np.uint32
            assert samples.sequence.dtype == np.int64

    def test_a_known_wrench_comes_out_as_that_wrench_to_a_step_of_the_device(
        self, rig: ForceSensorRig
    ) -> None:
        rig.wrench = constant(*KNOWN_WRENCH)
        rig.sensor.start()
        measured = rig.in_units(rig.run(0.5))
        assert len(measured) > 10
        assert np.all(np.abs(measured - np.array(KNOWN_WRENCH)) <= rig.resolution)

    def test_a_clean_stream_has_nothing_to_report(self, rig: ForceSensorRig) -> None:
        rig.sensor.start()
        samples = rig.run(1.0)
        assert rig.sensor.health() == StreamHealth(received=len(samples.sequence))

    def test_reading_never_waits(self, rig: ForceSensorRig) -> None:
        assert len(rig.sensor.read().sequence) == 0
        rig.sensor.start()
        before_s = rig.clock.now_s()
        for _ in range(5):
            rig.sensor.read()
        assert rig.clock.now_s() == before_s

    def test_stopping_is_allowed_at_any_time_any_number_of_times(self, rig: ForceSensorRig) -> None:
        rig.sensor.stop()
        rig.sensor.start()
        rig.run(0.2)
        for _ in range(3):
            rig.sensor.stop()
        assert len(rig.run(0.2).sequence) == 0

    def test_a_new_start_counts_from_zero_and_brings_nothing_old(self, rig: ForceSensorRig) -> None:
        rig.sensor.start()
        rig.run(0.3)
        rig.wrench = constant(*KNOWN_WRENCH)
        rig.sensor.start()
        samples = rig.run(0.3)
        assert samples.sequence[0] == 1
        assert samples.device_s[0] == 0.0
        assert np.all(np.abs(rig.in_units(samples) - np.array(KNOWN_WRENCH)) <= rig.resolution)
        assert rig.sensor.health().lost == rig.sensor.health().duplicate == 0

    def test_a_saturated_sensor_says_so_in_every_record(self, rig: ForceSensorRig) -> None:
        rig.sensor.start()
        good = rig.run(0.3)
        rig.wrench = constant(*rig.saturating)
        bad = rig.run(0.3)
        assert not good.status.any()
        flagged = bad.status != 0
        assert flagged.sum() > 0.2 * rig.rate_Hz
        assert np.all(bad.status[flagged] & ERROR)
        assert np.all(bad.status[flagged] & SATURATED)
        health = rig.sensor.health()
        assert health.saturated == health.faulty_status == flagged.sum()
        assert health.notes

    def test_lost_records_are_counted_and_time_goes_on_right(self, rig: ForceSensorRig) -> None:
        rig.sensor.start()
        rig.run(1.2)
        rig.lose()
        samples = rig.run(1.2)
        health = rig.sensor.health()
        assert health.lost > 0
        _assert_time_is_right(rig, samples)
        assert health.received + health.lost == pytest.approx(samples.sequence[-1], abs=1)

    def test_records_that_came_twice_are_handed_over_once(self, rig: ForceSensorRig) -> None:
        rig.sensor.start()
        rig.run(0.3)
        if rig.repeat is not None:
            rig.repeat()
        rig.run(0.5)
        numbers = np.concatenate([block.sequence for block in rig.blocks])
        assert np.all(np.diff(numbers) == 1)
        # Where the wire cannot duplicate records, none may be counted.
        assert (rig.sensor.health().duplicate > 0) == (rig.repeat is not None)
        assert rig.sensor.health().lost == 0

    def test_records_that_overtook_each_other_are_handed_over_in_order(
        self, rig: ForceSensorRig
    ) -> None:
        rig.sensor.start()
        rig.run(0.3)
        if rig.swap is not None:
            rig.swap()
        rig.run(0.5)
        numbers = np.concatenate([block.sequence for block in rig.blocks])
        assert np.all(np.diff(numbers) >= 1)
        assert (rig.sensor.health().out_of_order > 0) == (rig.swap is not None)

    def test_a_sensor_that_stands_still_is_counted_as_stalled(self, rig: ForceSensorRig) -> None:
        rig.sensor.start()
        rig.run(0.5)
        rig.freeze()
        rig.run(1.5)
        assert rig.sensor.health().stalled > 0.9 * rig.rate_Hz
        assert any("stood still" in note for note in rig.sensor.health().notes)

    def test_damaged_bytes_are_counted_and_the_stream_is_found_again(
        self, rig: ForceSensorRig
    ) -> None:
        rig.sensor.start()
        rig.run(1.2)
        rig.damage()
        rig.run(0.3)
        malformed = rig.sensor.health().malformed
        assert malformed > 0
        assert any(
            "thrown away" in note or "no records" in note for note in rig.sensor.health().notes
        )
        after = rig.run(1.0)
        assert rig.sensor.health().malformed == malformed
        assert len(after.sequence) > 0.9 * rig.rate_Hz - 5
        _assert_time_is_right(rig, after)

    def test_silence_shows_its_age(self, rig: ForceSensorRig) -> None:
        rig.sensor.start()
        rig.run(1.2)
        rig.silence()
        rig.run(0.5)
        (note,) = rig.sensor.health().notes
        assert "for 0.4" in note or "for 0.5" in note

    def test_the_identity_is_given_in_words(self, rig: ForceSensorRig) -> None:
        identity = rig.sensor.identity()
        assert {"make", "serial_number", "counts_per_N", "counts_per_Nm", "rate_Hz"} <= set(
            identity
        )
        assert all(isinstance(value, str) for value in identity.values())
        assert float(identity["rate_Hz"]) == pytest.approx(rig.rate_Hz, rel=1e-4)


def _assert_time_is_right(rig: ForceSensorRig, samples: ForceSamples) -> None:
    """Asserts that the lag of device time behind host time is the same as before the fault.

    Allowed are one latency, and the lag that a loss may hide: four periods and 12 ms.
    """
    first = next(block for block in rig.blocks if len(block.sequence))
    lag_before_s = first.host_s[0] - first.device_s[0]
    lag_after_s = samples.host_s[-1] - samples.device_s[-1]
    assert abs(lag_after_s - lag_before_s) < rig.latency_s + 4.0 / rig.rate_Hz + 0.012


@dataclass
class NoisyPort:
    """The driver's end of the line with faults: the next `drop` bytes are lost, the `spoil` bytes
    after them are changed.

    At most `most` bytes are reported as waiting at once.
    """

    end: HostEnd
    silent: bool = False
    drop: int = 0
    spoil: int = 0
    most: int = 1 << 16
    held: bytes = field(default=b"")

    @property
    def in_waiting(self) -> int:
        """Bytes that have arrived."""
        self._take()
        return min(self.most, len(self.held))

    def _take(self) -> None:
        data = self.end.read(self.end.in_waiting)
        if self.silent:
            data = b""
        lost = data[: self.drop]
        data = data[self.drop :]
        self.drop -= len(lost)
        spoilt = data[: self.spoil]
        data = data[self.spoil :]
        self.spoil -= len(spoilt)
        self.held += bytes(number ^ FLIPPED_BITS for number in spoilt) + data

    def read(self, size: int = 1) -> bytes:
        data = self.held[:size]
        self.held = self.held[size:]
        return data

    def write(self, data: bytes) -> int:
        return self.end.write(data)

    def close(self) -> None:
        self.end.close()
