"""Turns counted on from a position of 16 bits, and a speed held against its angle."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from rfca_rig.devices.cubemars.driver import SpeedCheck, WrappedPosition

ENDS = frozenset({0, 65535})


def follower() -> WrappedPosition:
    return WrappedPosition(ENDS, most_counts_s=131_000.0, margin_counts=800.0)


@given(st.integers(0, 65535), st.lists(st.integers(-1000, 1000), max_size=300))
def test_turns_are_counted_on_without_losing_a_count(first: int, steps: list[int]) -> None:
    position = follower()
    true = first
    assert position.follow(first, 0.0, 0.0) == first
    for at, step in enumerate(steps, 1):
        true += step
        assert position.follow(true % 65536, 2e-3 * at, 0.0) == true
    assert position.fault is None


@given(st.integers(-32768, 32767), st.integers(-30000, 30000))
def test_codes_with_sign_are_counted_on_too(first: int, step: int) -> None:
    position = follower()
    position.follow(first, 0.0, 0.0)
    assert position.follow((first + step + 32768) % 65536 - 32768, 1.0, 0.0) == first + step


@pytest.mark.parametrize(
    ("step", "leapt"), [(1000, False), (-1050, False), (1100, True), (-30000, True)]
)
def test_a_step_is_a_leap_where_no_motion_can_make_it(step: int, leapt: bool) -> None:
    position = follower()
    position.follow(30000, 0.0, 0.0)
    position.follow(30000 + step, 2e-3, 0.0)
    assert (position.fault is not None) == leapt


def test_after_a_pause_any_step_may_be_motion_and_a_leap_is_never_forgiven() -> None:
    position = follower()
    position.follow(30000, 0.0, 0.0)
    position.follow(50000, 1.0, 0.0)
    assert position.fault is None
    position.follow(30000, 1.002, 0.0)
    assert position.fault is not None
    position.forgive()
    assert position.follow(50000, 1.004, 0.0) == 50000
    assert position.fault is not None


def test_having_stood_at_the_end_of_the_range_is_forgiven() -> None:
    position = follower()
    for at in range(100):
        position.follow(0, 2e-3 * at, 1.0)
    assert position.fault is not None
    position.forgive()
    assert position.fault is None


@pytest.mark.parametrize(
    ("speed_rad_s", "stuck"), [(0.0, False), (0.3, False), (0.6, True), (-0.6, True)]
)
@pytest.mark.parametrize("end", sorted(ENDS))
def test_standing_at_the_end_of_the_range_is_a_fault_only_where_the_shaft_turns(
    end: int, speed_rad_s: float, stuck: bool
) -> None:
    position = follower()
    for at in range(100):
        position.follow(end, 2e-3 * at, speed_rad_s)
    assert (position.fault is not None) == stuck


def fed(factor: float, speed_rad_s: float, tick_s: float = 2e-3) -> SpeedCheck:
    check = SpeedCheck("the scales")
    for t_s in np.arange(0.0, 1.5, tick_s).tolist():
        check.follow(t_s, speed_rad_s * t_s, factor * speed_rad_s)
    return check


@pytest.mark.parametrize("factor", [0.8, 1.0, 1.25])
def test_a_speed_that_belongs_to_its_angle_is_no_fault(factor: float) -> None:
    assert fed(factor, 3.0).fault is None
    assert fed(factor, -0.6).fault is None


@pytest.mark.parametrize(
    ("factor", "said"), [(0.5, "0.5 times"), (9.0, "9 times"), (-1.0, "-1 times"), (0.0, "0 times")]
)
def test_a_speed_of_another_scale_is_told_with_the_factor(factor: float, said: str) -> None:
    assert said in (fed(factor, 3.0).fault or "")
    assert "check the scales" in (fed(factor, 3.0).fault or "")


def test_slow_motion_and_rare_reports_are_not_judged() -> None:
    assert fed(2.0, 0.2).fault is None
    assert fed(2.0, 3.0, tick_s=0.1).fault is None
