"""Every watch, on samples made for it: it trips beyond its limit, with its code, and not before."""

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from rfca_rig.drivers.roles import ForceSamples, MotorStatus, SensorScale, ShaftSamples
from rfca_rig.engine.limit_monitor import LimitMonitor, Tracking
from rfca_rig.errors import Trip, Tripped
from rfca_rig.protocol.check import Load
from rfca_rig.protocol.plan import Limits

LIMITS = Limits(
    force_N=300.0,
    torque_Nm=25.0,
    speed_rad_s=20.0,
    following_error_rad=0.3,
    following_error_s=0.1,
    sensor_silent_s=0.05,
    drive_silent_s=0.5,
    sensor_frozen_s=0.2,
    above_expected=2.0,
    above_expected_s=0.1,
    temperature_C=80.0,
    late_s=0.05,
    reading_age_s=0.1,
)
SCALE = SensorScale(1000.0, 1000.0, 1000.0)
RATE_Hz = 1000.0
PER_TICK = 10
WELL = MotorStatus("closed loop", None, 0.0)
ROOT = Path(__file__).parents[2]


class Rig:
    """A watch, and devices whose samples a test makes up; a tick is 10 ms of 1 kHz records with
    noise.
    """

    def __init__(self) -> None:
        self.monitor = LimitMonitor(LIMITS, SCALE, 0.0)
        self.random = np.random.default_rng(3)
        self.records = 0
        self.now_s = 0.0

    def force(self, force_N=0.0, torque_Nm=0.0, status=0, noise=5) -> ForceSamples:
        if noise:
            counts = self.random.integers(-noise, noise + 1, (PER_TICK, 6))
        else:
            counts = np.zeros((PER_TICK, 6))
        counts = counts + np.array([0, 0, -1000 * force_N, 1000 * torque_Nm, 0, 0])
        device_s = (self.records + np.arange(PER_TICK)) / RATE_Hz
        self.records += PER_TICK
        words = np.full(PER_TICK, status, np.uint32)
        return ForceSamples(device_s, device_s, np.arange(PER_TICK), words, counts.astype(np.int32))

    def shaft(self, angle_rad=0.0) -> ShaftSamples:
        one = np.array([self.now_s])
        return ShaftSamples(one, one, np.array([angle_rad]), np.zeros(1), np.array([1.5]))

    def ticks(self, count, force=None, shaft=None, status=WELL, tracking=None):
        for _ in range(count):
            self.now_s += PER_TICK / RATE_Hz
            self.monitor.reports(
                self.now_s, shaft or self.shaft(), force() if force else self.force()
            )
            self.monitor.motion(self.now_s, status, tracking or Tracking(0.0, 0.0, 0.0, 0.0))


def nothing_of(samples):
    return replace(samples, **{name: getattr(samples, name)[:0] for name in vars(samples)})


def trips(code, what, *args, **more):
    with pytest.raises(Tripped) as found:
        what(*args, **more)
    assert found.value.code == code
    assert str(found.value).startswith(f"TRIP {code}: ")
    return str(found.value)


def test_a_rig_where_all_is_well_never_trips():
    rig = Rig()
    rig.monitor.expect(Load(60.0, 6.0))
    rig.ticks(200, lambda: rig.force(55.0, 5.0), tracking=Tracking(1.0, 0.9, 3.0, 2.5))
    assert rig.monitor.peak.force_N == pytest.approx(55.0, abs=0.02)


@pytest.mark.parametrize(("load", "code"), [((301.0, 0.0), Trip.FORCE), ((0.0, 25.1), Trip.MOMENT)])
def test_one_record_above_a_limit_trips(load, code):
    rig = Rig()
    rig.ticks(3)
    trips(code, rig.ticks, 1, lambda: rig.force(*load))


@pytest.mark.parametrize(
    ("load", "code"), [((125.0, 0.0), Trip.FORCE_LASTS), ((0.0, 12.5), Trip.MOMENT_LASTS)]
)
def test_an_impact_may_pass_what_is_expected_and_a_press_may_not(load, code):
    rig = Rig()
    rig.monitor.expect(Load(60.0, 6.0))
    rig.ticks(3)
    rig.ticks(10, lambda: rig.force(*load))  # 99 ms from the first to the last
    rig.ticks(1)
    rig.ticks(10, lambda: rig.force(*load))
    said = trips(code, rig.ticks, 1, lambda: rig.force(*load))
    assert "120 N" in said or "12 N m" in said


def test_little_is_no_danger_however_little_is_expected():
    rig = Rig()
    rig.monitor.expect(Load(1.0, 0.1))
    rig.ticks(50, lambda: rig.force(29.0, 2.4))
    trips(Trip.FORCE_LASTS, rig.ticks, 50, lambda: rig.force(31.0))


def test_where_nobody_knows_what_to_expect_only_the_limit_counts():
    rig = Rig()
    rig.ticks(100, lambda: rig.force(290.0, 24.0))


def test_a_sensor_that_is_silent_trips_after_its_time():
    rig = Rig()
    rig.ticks(3)
    rig.ticks(5, lambda: nothing_of(rig.force()))
    trips(Trip.SENSOR_SILENT, rig.ticks, 1, lambda: nothing_of(rig.force()))


def test_a_sensor_that_never_spoke_is_silent_too():
    rig = Rig()
    trips(Trip.SENSOR_SILENT, rig.ticks, 6, lambda: nothing_of(rig.force()))


def test_a_frozen_sensor_trips_and_one_that_moves_by_a_count_does_not():
    rig = Rig()
    rig.ticks(100, lambda: rig.force(noise=1))
    rig.ticks(20, lambda: rig.force(noise=0))
    trips(Trip.SENSOR_FROZEN, rig.ticks, 2, lambda: rig.force(noise=0))


def test_lost_records_trip_only_where_nobody_saw_the_force_for_too_long():
    rig = Rig()
    rig.ticks(3)
    rig.records += 40
    rig.ticks(1)
    rig.records += 55
    trips(Trip.SENSOR_BLIND, rig.ticks, 1)


@pytest.mark.parametrize(
    ("word", "code"), [(0x80020000, Trip.SENSOR_SATURATED), (0x90000000, Trip.SENSOR_ERROR)]
)
def test_a_bad_status_word_trips(word, code):
    rig = Rig()
    rig.ticks(1, lambda: rig.force(status=0x80010000))  # a latched monitor condition is no danger
    trips(code, rig.ticks, 1, lambda: rig.force(status=word))


@pytest.mark.parametrize(
    ("status", "code"),
    [
        (MotorStatus("idle", "0x40 something", 0.0), Trip.DRIVE_ERROR),
        (MotorStatus("closed loop", None, 0.51), Trip.DRIVE_SILENT),
        (MotorStatus("closed loop", "no heartbeat for 0.51 s", 0.51), Trip.DRIVE_SILENT),
        (MotorStatus("closed loop", None, 0.0, 80.5), Trip.DRIVE_HOT),
        (MotorStatus("closed loop", None, 0.0, torque_age_s=0.11), Trip.READING_OLD),
        (MotorStatus("closed loop", None, np.nan), Trip.DRIVE_SILENT),
        (MotorStatus("closed loop", None, 0.0, np.nan), Trip.DRIVE_HOT),
    ],
)
def test_a_drive_in_trouble_trips(status, code):
    rig = Rig()
    rig.ticks(1, status=MotorStatus("closed loop", None, 0.49, 79.5))
    trips(code, rig.ticks, 1, status=status)


def test_a_drive_that_lives_but_tells_no_angle_trips():
    rig = Rig()
    rig.ticks(1)
    rig.ticks(9, shaft=nothing_of(rig.shaft()))
    assert "last angle is 110 ms old" in trips(
        Trip.READING_OLD, rig.ticks, 2, shaft=nothing_of(rig.shaft())
    )


def test_angles_that_come_regularly_but_late_trip():
    rig = Rig()
    rig.ticks(1)
    for late_s in (0.02, 0.09, 0.11):
        late = replace(rig.shaft(), host_s=np.array([rig.now_s + 0.01 - late_s]))
        if late_s <= LIMITS.reading_age_s:
            rig.ticks(1, shaft=late)
    assert "last angle is 110 ms old" in trips(Trip.READING_OLD, rig.ticks, 1, shaft=late)


def test_overspeed_following_and_jam():
    rig = Rig()
    rig.ticks(100, tracking=Tracking(0.0, 0.0, 0.1, 0.0))  # so slow a target may stand
    rig.ticks(29, tracking=Tracking(0.5, 0.0, 3.0, 0.29))
    trips(Trip.JAM, rig.ticks, 2, tracking=Tracking(0.5, 0.0, 3.0, 0.29))
    trips(Trip.OVERSPEED, Rig().ticks, 1, tracking=Tracking(0.0, 0.0, 20.0, 20.1))
    Rig().ticks(1, tracking=Tracking(0.59, 0.0, 3.0, 3.0))
    assert "35.0 deg" in trips(
        Trip.FOLLOWING, Rig().ticks, 1, tracking=Tracking(0.61, 0.0, 3.0, 3.0)
    )


def test_an_angle_that_jumps_further_than_a_shaft_can_turn_trips():
    rig = Rig()
    rig.ticks(1)
    rig.now_s += 0.01
    rig.monitor.reports(rig.now_s, rig.shaft(0.39), rig.force())
    rig.now_s += 0.01
    trips(Trip.JUMP, rig.monitor.reports, rig.now_s, rig.shaft(0.8), rig.force())


def test_a_late_loop_trips():
    monitor = LimitMonitor(LIMITS, SCALE, 0.0)
    monitor.gap(0.0515, 0.002)
    assert "51 ms late" in trips(Trip.LATE, monitor.gap, 0.053, 0.002)


def test_every_code_has_a_paragraph_that_says_what_to_do():
    text = (ROOT / "docs" / "trips.md").read_text()
    told = re.findall(r"([LFSDBC]-\d\d)", text)
    assert {code.value for code in Trip} <= set(told)
    assert set(told) <= {code.value for code in Trip}
