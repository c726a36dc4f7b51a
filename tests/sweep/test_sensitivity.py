"""First-order indices against functions whose indices are known."""

import numpy as np
import pytest

from rfca_rig.sweep.plan import Range, SweepSamples, first_order, points, shares

A = 7.0
B = 0.1


def ishigami(x: np.ndarray) -> np.ndarray:
    return np.sin(x[:, 0]) + A * np.sin(x[:, 1]) ** 2 + B * x[:, 2] ** 4 * np.sin(x[:, 0])


def exact() -> list[float]:
    """Ishigami and Homma 1990."""
    variance = A**2 / 8 + B * np.pi**4 / 5 + B**2 * np.pi**8 / 18 + 0.5
    return [0.5 * (1.0 + B * np.pi**4 / 5) ** 2 / variance, A**2 / 8 / variance, 0.0]


def drawn(n: int, method="sobol", seed=1) -> SweepSamples:
    return SweepSamples(tuple(Range(name, -np.pi, np.pi) for name in "xyz"), method, n, seed)


@pytest.mark.parametrize("method", ["sobol", "latin hypercube"])
def test_ishigami(method):
    samples = drawn(1024, method)
    y = ishigami(points(samples))
    for share, index in zip(shares(samples).T, exact(), strict=True):
        found = first_order(share, y, np.random.default_rng(0))
        assert found.index == pytest.approx(index, abs=0.03)
        assert abs(found.index - index) < 3.0 * found.std
        assert found.std < 0.04


def test_few_points_are_not_flattered_and_the_error_is_honest():
    """With 64 random points: no influence is 0 on average, and errors of the index are as large
    as their standard error says.
    """
    found = {place: [] for place in range(3)}
    for seed in range(24):
        rng = np.random.default_rng(seed)
        share = rng.random((64, 3))
        y = share[:, 0] + 0.5 * rng.standard_normal(64)
        for place in (0, 2):
            found[place].append(first_order(share[:, place], y, rng))
    truth = (1 / 12) / (1 / 12 + 0.25)
    none, some = (np.array([each.index for each in found[place]]) for place in (2, 0))
    assert abs(none.mean()) < 0.03 and abs(some.mean() - truth) < 0.03
    assert np.mean([each.std for each in found[0]]) == pytest.approx(some.std(), rel=0.45)


def test_missing_values_are_left_out_and_too_few_say_nothing():
    samples = drawn(256)
    y = points(samples)[:, 0] ** 3
    y[::5] = np.nan
    assert first_order(shares(samples)[:, 0], y, np.random.default_rng(0)).index > 0.999
    y[20:] = np.nan
    assert first_order(shares(samples)[:, 0], y, np.random.default_rng(0)) is None
    assert first_order(shares(samples)[:, 0], np.full(256, 3.0), np.random.default_rng(0)) is None
