"""A position that went further than a shaft can turn, and frames that are too many."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from rfca_rig.devices.odrive.driver import TemperatureTelemetry
from rfca_rig.drivers.device_time import FrameCount
from rfca_rig.drivers.drive_report import EncoderJumpMonitor
from rfca_rig.errors import BadReading


def followed(
    angles_rad: np.ndarray, speeds_rad_s: np.ndarray, period_s: float = 2e-3
) -> EncoderJumpMonitor:
    watch = EncoderJumpMonitor()
    for at, (angle_rad, speed_rad_s) in enumerate(
        zip(angles_rad.tolist(), speeds_rad_s.tolist(), strict=True)
    ):
        watch.follow(period_s * at, period_s * at, angle_rad, speed_rad_s)
    return watch


@given(st.floats(-15.0, 15.0), st.floats(0.5, 30.0), st.sampled_from([1e-3, 2e-3, 1e-2]))
def test_a_motion_is_no_leap_however_fast(
    amplitude_rad: float, omega_rad_s: float, period_s: float
) -> None:
    amplitude_rad /= omega_rad_s
    t_s = period_s * np.arange(200)
    watch = followed(
        amplitude_rad * np.sin(omega_rad_s * t_s),
        amplitude_rad * omega_rad_s * np.cos(omega_rad_s * t_s),
        period_s,
    )
    assert watch.fault is None


def test_a_stop_dead_from_20_rad_s_is_no_leap() -> None:
    t_s = 2e-3 * np.arange(100)
    watch = followed(20.0 * np.minimum(t_s, 0.1), np.where(t_s < 0.1, 20.0, 0.0))
    assert watch.fault is None


@pytest.mark.parametrize("by_rad", [0.2, -0.2, 0.698, 6.28])
@pytest.mark.parametrize("speed_rad_s", [0.0, 3.0])
def test_a_leap_is_told_with_how_far_and_stays(by_rad: float, speed_rad_s: float) -> None:
    t_s = 2e-3 * np.arange(100)
    watch = followed(speed_rad_s * t_s + by_rad * (t_s >= 0.1), np.full(100, speed_rad_s))
    assert f"leapt by {by_rad + 2e-3 * speed_rad_s:.2f} rad within 2.0 ms" in (watch.fault or "")
    assert "find its zero again" in (watch.fault or "")


def test_lost_reports_are_no_leap() -> None:
    """The device's time does not know of them yet, the host's does."""
    watch = EncoderJumpMonitor()
    watch.follow(0.0, 0.0, 0.0, 5.0)
    watch.follow(0.1, 0.002, 0.5, 5.0)
    assert watch.fault is None


def counted(per_look: int, looks: int = 1200, period_s: float = 1e-3) -> FrameCount:
    count = FrameCount(period_s)
    for at in range(looks):
        count.stamp(per_look, 2e-3 * at)
    return count


def test_frames_that_come_twice_are_too_many() -> None:
    assert counted(2).fault is None
    assert "2000 times a second where 1000 are set" in (counted(4).fault or "")


def test_frames_that_an_adapter_held_back_are_not_too_many() -> None:
    count = FrameCount(1e-3)
    for at in range(3000):
        held = at % 50 != 0
        count.stamp(0 if held else 100, 2e-3 * at)
    count.stamp(500, 6.5)
    assert count.fault is None


def test_what_a_long_pause_has_dammed_up_is_not_too_many_though_its_tail_comes_late() -> None:
    count = FrameCount(1e-3)
    for at in range(500):
        count.stamp(2, 2e-3 * at)
    count.stamp(20_000, 61.0)
    count.stamp(10_000, 61.01)
    for at in range(1000):
        count.stamp(2, 61.02 + 2e-3 * at)
    assert count.fault is None


def test_the_warmest_of_what_is_told_counts_and_that_it_is_told_no_more() -> None:
    temperature = TemperatureTelemetry()
    assert temperature.fault(100.0) is None
    temperature.update(1.0, 35.0, float("nan"))
    assert temperature.warmest_C == 35.0
    temperature.update(2.0, 35.0, 61.5)
    assert temperature.warmest_C == 61.5
    assert temperature.fault(11.9) is None
    assert "no temperature for 11 s" in (temperature.fault(13.0) or "")
    temperature.update(14.0, 35.0, float("nan"))
    assert temperature.warmest_C == 61.5
    temperature.update(15.0, 35.0, 1e30)
    with pytest.raises(BadReading, match="motor temperature nan degC, 3 bad reports"):
        temperature.update(16.0, 35.0, float("nan"))
