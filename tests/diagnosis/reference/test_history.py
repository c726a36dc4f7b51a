"""Trends over many runs: found within their intervals, and none where there is none."""

import numpy as np
import pytest

from rfca_rig.diagnosis.reference.history import FALSE_TRENDS, INTERVAL, Trend, fit_trend
from rfca_rig.diagnosis.result import Value

DAY_S = 86400.0
RUNS = 30
VALUES = 7


def history(rise, random, scatter=0.1, std=0.1, began_s=None):
    """Changes that rise from run to run, or over time, with scatter, and the trend in them."""
    if began_s is None:
        share = np.linspace(0.0, 1.0, RUNS)
        began_s = DAY_S * np.arange(RUNS)
    else:
        share = (began_s - began_s[0]) / np.ptp(began_s)
    values = rise * share + scatter * random.standard_normal(len(share))
    return fit_trend(list(began_s), [Value(float(value), std) for value in values], VALUES)


@pytest.mark.parametrize("scatter", [0.1, 0.3], ids=["as stated", "three times as stated"])
def test_a_trend_lies_within_its_interval(scatter):
    held = 0
    for seed in range(200):
        trend = history(2.0, np.random.default_rng(seed), scatter)
        held += abs(trend.change - 2.0) <= trend.half_width
        assert trend.is_clear
    assert held / 200 == pytest.approx(INTERVAL, abs=0.06)


def test_scatter_alone_is_no_trend_of_any_value():
    false_trends = 0
    for seed in range(200):
        random = np.random.default_rng(seed)
        false_trends += any(history(0.0, random, 0.3).is_clear for _ in range(VALUES))
    assert false_trends / 200 < FALSE_TRENDS


def test_wear_from_run_to_run_is_told_from_drift_over_time():
    random = np.random.default_rng(2)
    uneven_s = DAY_S * np.sort(random.uniform(0.0, 100.0, RUNS)) ** 2
    over_time = history(3.0, random, began_s=uneven_s)
    assert over_time.over == "time"
    by_run = [Value(float(value), 0.1) for value in np.linspace(0.0, 3.0, RUNS)]
    over_runs = fit_trend(list(uneven_s), by_run, VALUES)
    assert over_runs.over == "runs"
    assert over_runs.change == pytest.approx(3.0, abs=1e-6)


def test_three_runs_have_no_trend():
    assert fit_trend([0.0, 1.0, 2.0], [Value(0.0, 0.1)] * 3, VALUES) is None


def test_runs_at_the_same_time_still_wear():
    changes = [Value(0.1 * number, 0.01) for number in range(10)]
    trend = fit_trend([5.0] * 10, changes, VALUES)
    assert isinstance(trend, Trend)
    assert trend.over == "runs"
    assert trend.change == pytest.approx(0.9)
