import numpy as np
import pytest

from rfca_rig.analysis.phases import local_quadratic


def test_a_parabola_is_returned_exactly_from_uneven_samples():
    t = np.sort(np.random.default_rng(1).uniform(0.0, 1.0, 800))
    at = np.linspace(0.1, 0.9, 7)
    fit = local_quadratic(t, 2.0 - 3.0 * t + 40.0 * t**2, at, 0.05)
    assert fit.value == pytest.approx(2.0 - 3.0 * at + 40.0 * at**2, abs=1e-9)
    assert fit.slope == pytest.approx(-3.0 + 80.0 * at, abs=1e-7)
    assert fit.curvature == pytest.approx(np.full(7, 80.0), abs=1e-5)


@pytest.mark.parametrize("rate_Hz", [1000.0, 15000.0])
def test_the_window_is_one_of_time_whatever_the_rate(rate_Hz):
    t = np.arange(0, int(rate_Hz)) / rate_Hz
    cubic = local_quadratic(t, t**3, np.array([0.5]), 0.1)
    assert cubic.slope[0] == pytest.approx(3 * 0.25 + 3.0 / 5.0 * 0.05**2, rel=3e-4), (
        "slope of x^3 over +-h is 3x^2 + 3h^2/5"
    )


def test_a_gap_gives_nan_and_not_a_guess():
    t = np.concatenate([np.arange(0.0, 0.4, 1e-3), np.arange(0.6, 1.0, 1e-3)])
    fit = local_quadratic(t, t, np.array([0.2, 0.5]), 0.02)
    assert np.isfinite(fit.value[0]) and np.isnan(fit.value[1])
