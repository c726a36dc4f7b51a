"""Where a rig file and a device of a lab's own do not agree on how often it speaks; and time,
where it speaks only when spoken to.
"""

import numpy as np
import pytest

from rfca_rig.clock import TwinClock
from rfca_rig.contracts.motor_rig import concatenate_samples, motor_rig
from rfca_rig.description.rig_file import read_rig
from rfca_rig.devices.own import twin_of
from rfca_rig.doctor.rig_checks import judge_own_sensor
from rfca_rig.errors import DeviceError
from rfca_rig.twins.drive_parts import LoopGains
from rfca_rig.twins.wires import serial_line
from tests.own_devices import test_contracts
from tests.own_devices.rigs import EXAMPLES
from tests.own_devices.test_contracts import Polled, PolledTwin

RIG = read_rig(EXAMPLES / "our-rig.toml")


def test_a_drive_that_reports_more_rarely_than_the_rig_file_says_is_not_enabled():
    keys = RIG.motor
    slow = RIG.motor.model_copy(update={"report_period_ms": 8.0})
    twin = twin_of(keys)
    with motor_rig(
        lambda bus, clock: keys.driver(bus, clock, 0.3),
        lambda bus: twin(bus, slow, LoopGains(), 0.1),
    ) as rig:
        with pytest.raises(
            DeviceError,
            match="not enabled: it does not report every 2 ms; set report_period_ms to what",
        ):
            rig.motor.enable()
        rig.tick()
        assert not rig.twin.is_on


def sensor_on(twins_rate_Hz):
    keys = RIG.force_sensor
    clock = TwinClock()
    (host, device) = serial_line()
    twin = twin_of(keys)(
        device,
        keys.model_copy(update={"rate_Hz": twins_rate_Hz}),
        (0.1,) * 6,
        np.random.default_rng(1),
    )

    def carry(to_s):
        twin.take_requests()
        twin.take_wrench(np.zeros((len(twin.due(to_s)), 6)))

    clock.carry(carry)
    sensor = keys.driver(host, clock)
    sensor.start()
    return sensor, clock, device


def test_a_sensor_at_another_rate_than_the_rig_file_says_ends_the_stream_within_two_seconds():
    sensor, clock, _ = sensor_on(400.0)
    with pytest.raises(
        DeviceError,
        match=r"force sensor sends 400\.\d records/s, the rig file says 800; put that into rate_Hz",
    ):
        for _ in range(1000):
            clock.wait_until(clock.now_s() + 2e-3)
            sensor.read()


def test_a_stretch_of_garbage_counts_once_and_what_comes_after_it_is_found():
    sensor, clock, device = sensor_on(800.0)
    clock.wait_until(clock.now_s() + 0.1)
    device.write(b"\xaa\x01\x02" * 30)
    clock.wait_until(clock.now_s() + 0.1)
    assert len(sensor.read().sequence) == pytest.approx(160, abs=2)
    assert sensor.health().malformed == 1
    assert sensor.health().lost == 0


def test_an_answer_is_stamped_with_when_it_was_asked_for():
    """In ticks of 2 and 8 ms in turn, angle over device time is a straight line only if each is
    the moment of its question.
    """
    keys = test_contracts.TestADriveThatOnlyAnswers.keys
    with motor_rig(
        lambda bus, clock: Polled(bus, clock, keys, 0.3),
        lambda bus: PolledTwin(bus, keys, LoopGains(), 0.1),
    ) as rig:
        rig.motor.enable()
        rig.run(1.0, speed_rad_s=3.0)
        blocks = []
        for number in range(100):
            rig.motor.command_speed(3.0)
            rig.tick(tick_s=2e-3 if number % 2 else 8e-3)
            blocks.append(rig.motor.read())
        shaft = concatenate_samples(blocks)
        slope, offset = np.polyfit(shaft.device_s, shaft.angle_rad, 1)
        assert np.abs(shaft.angle_rad - slope * shaft.device_s - offset).max() < 2e-3


class FailingSensor:
    """Its wire breaks while it streams."""

    def __init__(self) -> None:
        self.is_streaming = False

    def start(self) -> None:
        self.is_streaming = True

    def read(self) -> None:
        raise DeviceError("the wire is broken")

    def stop(self) -> None:
        self.is_streaming = False


def test_a_sensor_whose_reading_fails_is_told_to_stop():
    sensor = FailingSensor()
    assert "the wire is broken" in judge_own_sensor(sensor, TwinClock()).seen
    assert not sensor.is_streaming
