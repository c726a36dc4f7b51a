"""The band of a comparison with leading and lagging time tolerance, beside a slow direct
implementation and beside cases made by hand.
"""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rfca_rig.analysis.acceptance import SignalTolerance, make_band


def make_band_directly(t_s, measured, tolerance):
    """The definition, sample by sample."""
    lower = []
    upper = []
    for now_s in t_s:
        first_s = now_s - tolerance.lag_s - 1e-9
        last_s = now_s + tolerance.lead_s + 1e-9
        within = [
            (value, max(tolerance.absolute, tolerance.relative * abs(value)))
            for moment_s, value in zip(t_s, measured, strict=True)
            if first_s <= moment_s <= last_s
        ]
        lower.append(min(value - allowed for value, allowed in within))
        upper.append(max(value + allowed for value, allowed in within))
    return np.array(lower), np.array(upper)


@settings(max_examples=200, deadline=None)
@given(
    steps_ms=st.lists(st.integers(1, 40), min_size=1, max_size=60),
    seed=st.integers(0, 1000),
    absolute=st.sampled_from([0.0, 0.5, 30.0]),
    relative=st.sampled_from([0.0, 0.1, 1.0]),
    lead_ms=st.integers(0, 120),
    lag_ms=st.integers(0, 120),
)
def test_the_band_is_that_of_the_definition_with_uneven_samples(
    steps_ms, seed, absolute, relative, lead_ms, lag_ms
):
    t_s = np.cumsum(steps_ms) / 1e3
    measured = np.random.default_rng(seed).normal(0.0, 10.0, len(t_s))
    tolerance = SignalTolerance(absolute, relative, lead_ms / 1e3, lag_ms / 1e3)
    expected = make_band_directly(t_s, measured, tolerance)
    np.testing.assert_array_equal(make_band(t_s, measured, tolerance), expected)


T_S = np.arange(0.0, 1.0, 1e-3)


def passes(simulated, tolerance):
    """Whether the sine is met, apart from its ends, where no baseline stands before or behind."""
    lower, upper = make_band(T_S, np.sin(20.0 * T_S), tolerance)
    inside = (lower <= simulated + 1e-12) & (simulated <= upper + 1e-12)
    return bool(inside[100:-100].all())


@pytest.mark.parametrize("delay_ms", [-12, -5, 0, 5, 12])
@pytest.mark.parametrize(("lead_ms", "lag_ms"), [(0, 0), (10, 0), (0, 10), (10, 10)])
def test_a_pure_delay_passes_up_to_the_lag_tolerance_and_an_advance_up_to_the_lead(
    delay_ms, lead_ms, lag_ms
):
    simulated = np.sin(20.0 * (T_S - delay_ms / 1e3))
    tolerance = SignalTolerance(0.0, 0.0, lead_ms / 1e3, lag_ms / 1e3)
    assert passes(simulated, tolerance) is (-lead_ms <= delay_ms <= lag_ms)


def test_a_delay_of_exactly_the_tolerance_passes_in_spite_of_rounded_times():
    tolerance = SignalTolerance(0.0, lag_s=0.007)
    assert passes(np.sin(20.0 * (T_S - 0.007)), tolerance)
    assert not passes(np.sin(20.0 * (T_S - 0.008)), tolerance)


def test_the_larger_tolerance_counts():
    t_s = np.array([0.0, 1.0])
    lower, upper = make_band(t_s, np.array([-100.0, 1.0]), SignalTolerance(2.0, 0.05))
    assert lower.tolist() == [-105.0, -1.0]
    assert upper.tolist() == [-95.0, 3.0]


def test_a_time_tolerance_does_not_move_a_level():
    """Within a window the values of a step are allowed, and nothing between its height and more."""
    measured = np.where(T_S < 0.5, 0.0, 10.0)
    lower, upper = make_band(T_S, measured, SignalTolerance(1.0, lead_s=0.02, lag_s=0.05))
    assert (lower[T_S < 0.48 - 1e-9] == -1.0).all() and (upper[T_S < 0.48 - 1e-9] == 1.0).all()
    between = (T_S > 0.4805) & (T_S < 0.5495)
    assert (lower[between] == -1.0).all() and (upper[between] == 11.0).all()
    assert (lower[T_S > 0.5505] == 9.0).all()
