"""Faults of columns: what is a fault, and what is only motion, noise or a coarse encoder."""

import numpy as np
import pytest

from rfca_rig.campaign.column_faults import (
    estimate_lag,
    find_glitches,
    find_limit,
    find_register_range,
    find_update_period,
)

T = np.arange(0.0, 10.0, 0.005)
SWING = 1.2 * np.sin(2.0 * T)
NOISE = np.random.default_rng(1).normal(0.0, 0.002, T.size)
ENCODER_STEP = 2.0 * np.pi / 4096


def quantized(values, step=ENCODER_STEP):
    return step * np.round(values / step)


def clipped(values):
    return np.clip(values, -0.9, 0.9)


def bounce(seconds):
    """Height of a ball that loses nothing."""
    return np.abs(np.sin(3.0 * seconds))


@pytest.mark.parametrize("column", [SWING + NOISE, quantized(SWING), quantized(SWING + NOISE)])
def test_samples_that_jump_away_and_come_back_are_glitches(column):
    spoiled = column.copy()
    spoiled[500] += 0.5
    spoiled[900:902] -= 0.8
    spoiled[1300] += 7.0
    assert find_glitches(spoiled).tolist() == [500, 900, 901, 1300]


@pytest.mark.parametrize(
    "column",
    [
        SWING + NOISE,
        NOISE,
        quantized(SWING),
        quantized(0.1 * NOISE + 0.5 * ENCODER_STEP),
        bounce(T),
        np.where(T < 5.0, SWING, SWING + 2.0),
        np.cumsum(np.sign(np.sin(5.0 * T))),
        np.zeros(T.size),
        np.array([0.0, 1.0]),
        np.array([0.0, 9.0, 0.0]),
    ],
    ids=[
        "swing",
        "noise",
        "encoder",
        "flicker",
        "bounce",
        "step",
        "triangle",
        "dead",
        "short",
        "three",
    ],
)
def test_motion_noise_and_encoder_steps_are_no_glitches(column):
    assert find_glitches(column).size == 0


def test_a_register_that_lost_its_sign_jumps_across_its_range():
    counts = np.round(2000.0 * SWING)
    assert find_register_range(np.mod(counts, 2.0**16)) == 2.0**16
    assert find_register_range(np.mod(counts, 2.0**32)) == 2.0**32
    assert find_register_range(counts) is None
    assert find_register_range(np.abs(counts)) is None


def test_a_channel_that_is_updated_rarely_has_a_period():
    assert find_update_period(np.repeat((SWING + NOISE)[::40], 40)) == 40
    assert find_update_period(SWING + NOISE) is None


def test_an_encoder_that_turns_slowly_and_evenly_is_no_rare_channel():
    assert find_update_period(quantized(0.05 * T)) is None


@pytest.mark.parametrize("column", [clipped(SWING), clipped(SWING + NOISE), clipped(-SWING)])
def test_a_sensor_at_its_limit_is_found(column):
    limit = find_limit(column)
    assert limit is not None
    value, samples = limit
    assert abs(value) == 0.9
    assert samples == pytest.approx(np.count_nonzero(column == value), rel=0.1)


@pytest.mark.parametrize(
    "column",
    [
        SWING,
        quantized(SWING),
        quantized(SWING, 0.2),
        quantized(np.where(T % 2.0 < 1.0, 1.0, np.cos(np.pi * (T % 2.0 - 1.0)) ** 4)),
        np.zeros(T.size),
    ],
    ids=["swing", "encoder", "coarse", "rests", "dead"],
)
def test_turning_points_and_rests_are_no_limit(column):
    assert find_limit(column) is None


@pytest.mark.parametrize("lag_s", [0.012, -0.007, 0.0])
def test_the_lag_of_a_column_is_measured(lag_s):
    speed = 2.4 * np.cos(2.0 * T) + 1.1 * np.cos(7.0 * T)
    late = np.interp(T - lag_s, T, speed) + 5.0 * NOISE
    lag = estimate_lag(T, late, speed, 0.05)
    assert lag.lag_s == pytest.approx(lag_s, abs=0.5e-3)
    assert (lag.gain > 0.9) == (lag_s != 0.0)
