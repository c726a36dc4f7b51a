import numpy as np
import pytest

from rfca_rig.analysis.matched_simulation import average_speed
from rfca_rig.analysis.repeats import Spread, compute_spread, group_by_condition
from tests.analysis import traces

T = traces.even(1000.0)


def flap(height_m, speed_rad_s, repeat):
    return traces.stroke(T, None, height_m=height_m, speed_rad_s=speed_rad_s, repeat=repeat)


def test_strokes_of_one_height_and_speed_belong_together_in_order():
    strokes = [
        flap(0.235, 2.433, 1),
        flap(0.215, 3.25, 2),
        flap(0.215, 3.25, 1),
        flap(0.21500001, 2.433, 1),
    ]
    found = [(c.label, [s.repeat for s in c.strokes]) for c in group_by_condition(strokes)]
    assert found == [
        ("215 mm, 2.433 rad/s", [1]),
        ("215 mm, 3.25 rad/s", [1, 2]),
        ("235 mm, 2.433 rad/s", [1]),
    ]


def test_spread_is_the_samples_own():
    assert compute_spread([1.0, 2.0, 3.0]) == Spread(2.0, 1.0, 3)
    assert compute_spread([4.0]) == Spread(4.0, None, 1)
    assert compute_spread([]) == Spread(None, None, 0)


def turned(speed_rad_s, ramp_s=0.05, until_s=np.inf):
    moving = np.clip(np.minimum(T, until_s), 0.0, None)
    return 0.25 + speed_rad_s * np.where(
        moving < ramp_s, 0.5 * moving**2 / ramp_s, moving - 0.5 * ramp_s
    )


def test_average_speed_is_the_turn_over_its_time():
    noise = np.random.default_rng(2).normal(0.0, 1e-4, len(T))
    average = average_speed(traces.stroke(T, None, shaft_angle_rad=turned(2.3) + noise), 0.05)
    assert (average.speed_rad_s, average.taken_from) == (
        pytest.approx(2.3, abs=1e-3),
        "shaft angle",
    )


def test_a_shaft_that_stands_still_afterwards_does_not_lower_the_average():
    average = average_speed(traces.stroke(T, None, shaft_angle_rad=turned(2.3, until_s=0.9)), 0.05)
    assert average.speed_rad_s == pytest.approx(2.3, abs=5e-3)


def test_without_an_angle_the_recorded_speed_is_taken_and_then_the_command():
    speed = np.where(T < 0.05, 0.0, np.where(T < 1.0, 2.2, 0.0))
    by_speed = average_speed(traces.stroke(T, None, shaft_speed_rad_s=speed), 0.05)
    assert (by_speed.speed_rad_s, by_speed.taken_from) == (pytest.approx(2.2), "shaft speed")
    assert average_speed(traces.stroke(T, None), 0.05).taken_from == "command"
