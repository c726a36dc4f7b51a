import numpy as np
import pytest

from rfca_rig.analysis.phases import (
    Undetermined,
    Valley,
    find_valley,
    stroke_valley,
    valley_and_phases,
)
from rfca_rig.model.stroke import simulate_stroke_at_speed
from tests.analysis import traces
from tests.model.legs import PAPER


@pytest.mark.parametrize("rate_Hz", [1000.0, 15000.0])
def test_a_clean_valley_is_found_between_the_samples(rate_Hz):
    t = traces.even(rate_Hz)
    valley = find_valley(t, traces.fz(t))
    assert valley.time_s == pytest.approx(traces.VALLEY_S, abs=1e-6)
    assert valley.fz_N == pytest.approx(traces.VALLEY_N, abs=1e-6)


@pytest.mark.parametrize("rate_Hz", [1000.0, 4000.0, 15000.0])
def test_noise_and_spike_do_not_move_the_valley(rate_Hz):
    """Time scatters by the noise of the slope over the curvature, which falls with the root of
    the rate.
    """
    t = traces.even(rate_Hz)
    slope_std = 0.15 * np.sqrt(12.0 / (0.02 * rate_Hz)) / 0.02
    for seed in range(8):
        noise = np.random.default_rng(seed).normal(0.0, 0.15, len(t))
        valley = find_valley(t, traces.fz(t, spike_N=-90.0) + noise)
        assert abs(valley.time_s - traces.VALLEY_S) < 4.0 * slope_std / traces.CURVATURE
        assert valley.fz_N == pytest.approx(traces.VALLEY_N, abs=0.25)


def test_uneven_time_stamps_give_the_same_valley():
    t = traces.uneven(np.random.default_rng(3))
    valley = find_valley(t, traces.fz(t))
    assert (valley.time_s, valley.fz_N) == pytest.approx(
        (traces.VALLEY_S, traces.VALLEY_N), abs=1e-6
    )


def test_a_deeper_rebound_is_not_the_valley():
    t = traces.even(1000.0)
    fz = traces.fz(t, valley_N=-15.0, rebound_N=-80.0)
    assert fz.min() < -70.0
    assert find_valley(t, fz).fz_N == pytest.approx(-15.0, abs=0.1)


def test_a_leg_that_snaps_free_leaves_no_false_minimum_before_the_jump():
    """A parabola fitted across a jump overshoots on both sides of it by a seventh of its height."""
    t = traces.even(1000.0)
    fz = np.where(t > traces.VALLEY_S + 0.04, 60.0, traces.fz(t))
    fz = np.where(t > traces.VALLEY_S + 0.08, traces.REST_N, fz)
    assert find_valley(t, fz).time_s == pytest.approx(traces.VALLEY_S, abs=1e-6)


def test_the_valley_of_the_models_own_stroke_is_its_minimum_and_found_again_in_noise():
    t = traces.even(1000.0)
    simulated = simulate_stroke_at_speed(PAPER, 0.215, 2.433, t)
    clean = find_valley(t, simulated.fz_N)
    assert clean.fz_N == pytest.approx(simulated.fz_N.min(), abs=0.1)
    assert clean.time_s == pytest.approx(t[simulated.fz_N.argmin()], abs=0.003)
    noisy = [
        find_valley(t, simulated.fz_N + np.random.default_rng(seed).normal(0.0, 0.15, len(t)))
        for seed in range(12)
    ]
    assert np.std([v.time_s for v in noisy]) < 0.0015
    assert np.std([v.fz_N for v in noisy]) < 0.08
    assert np.mean([v.time_s for v in noisy]) == pytest.approx(clean.time_s, abs=0.0015)


def test_a_recording_that_ends_while_the_force_still_falls_is_refused():
    t = traces.even(1000.0, end_s=0.9)
    refused = find_valley(t, traces.fz(t) + np.random.default_rng(0).normal(0.0, 0.15, len(t)))
    assert isinstance(refused, Undetermined)
    assert "still falls" in refused.reason and "record longer" in refused.reason


def test_a_spike_that_outweighs_the_loading_is_refused():
    t = traces.even(1000.0)
    fz = np.where(t < traces.TOUCHDOWN_S, 3.0, -40.0 + 30.0 * (t - traces.TOUCHDOWN_S))
    refused = find_valley(t, fz)
    assert isinstance(refused, Undetermined)
    assert "spike outweighs" in refused.reason


def test_a_swing_in_the_air_has_no_contact():
    t = traces.even(1000.0)
    for speed_rad_s in (2.433, 4.5):
        simulated = simulate_stroke_at_speed(PAPER, 1.0, speed_rad_s, t)
        refused = find_valley(
            t, simulated.fz_N + np.random.default_rng(0).normal(0.0, 0.15, len(t))
        )
        assert isinstance(refused, Undetermined) and "no contact" in refused.reason


def test_gaps_and_scraps_are_refused_with_their_place():
    t = traces.even(1000.0)
    gap = (t < 0.5) | (t > 0.6)
    assert "at 0.5" in find_valley(t[gap], traces.fz(t)[gap]).reason
    assert "0.010 s only" in find_valley(t[:11], t[:11]).reason
    assert "0.000 s only" in find_valley(t[:0], t[:0]).reason
    assert stroke_valley(traces.stroke(t, None)) == Undetermined("fz was not recorded")


def test_the_valley_divides_loading_from_release():
    t = traces.even(1000.0)
    valley, phases = valley_and_phases(t, traces.fz(t, spike_N=-20.0))
    assert isinstance(valley, Valley)
    assert phases.touchdown_s == pytest.approx(traces.TOUCHDOWN_S, abs=0.004)
    assert phases.valley_s == valley.time_s
    assert phases.lift_off_s == pytest.approx(traces.LIFT_OFF_S, abs=0.011), (
        "smoothing brings it forward by half a window at most"
    )
