"""Device time from a millisecond counter, between two clocks that do not agree."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from rfca_rig.drivers.device_time import CounterClock


def stamped(asked_s: np.ndarray, true_s: np.ndarray, begins: int = 0) -> np.ndarray:
    """What the clock makes of questions asked at `asked_s` that a device answered at `true_s` of
    its own time.
    """
    clock = CounterClock()
    counters = (np.floor(true_s * 1e3).astype(np.int64) + begins + (1 << 31)) % (1 << 32) - (
        1 << 31
    )
    return np.array(
        [clock.stamp(int(counter), asked) for counter, asked in zip(counters, asked_s, strict=True)]
    )


@given(
    st.integers(0, 1000),
    st.floats(-1e-4, 1e-4),
    st.sampled_from([0, (1 << 31) - 500, (1 << 32) - 200]),
)
def test_a_moment_is_right_to_a_count_whatever_drift_and_late_questions(
    seed: int, drift: float, begins: int
) -> None:
    random = np.random.default_rng(seed)
    asked_s = np.cumsum(0.002 + random.exponential(2e-4, 500))
    true_s = (asked_s + random.exponential(1e-4, 500)) * (1.0 + drift) + 0.3
    error_s = stamped(asked_s, true_s, begins) - (true_s - true_s[0])
    assert np.abs(error_s).max() < 1.6e-3


def test_steady_questions_are_stamped_far_finer_than_the_counter() -> None:
    asked_s = 0.00237 * np.arange(2000)
    true_s = asked_s * (1.0 + 3e-5) + 1.0
    error_s = stamped(asked_s, true_s) - (true_s - true_s[0])
    assert np.ptp(error_s[400:]) < 1e-4


def test_time_never_runs_back_even_where_the_device_starts_anew() -> None:
    clock = CounterClock()
    first = [clock.stamp(5000 + 2 * k, 0.002 * k) for k in range(100)]
    second = [clock.stamp(2 * k, 0.5 + 0.002 * k) for k in range(100)]
    assert np.all(np.diff(first + second) >= 0.0)
    assert second[0] == pytest.approx(0.5, abs=1e-3)
    assert clock.restarts == 1
