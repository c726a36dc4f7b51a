"""What is drawn against what numpy says of the same samples: every least and greatest, in
whatever pieces they came.
"""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rfca_rig.view.pyramid import (
    AHEAD,
    BASE_S,
    CAPACITY,
    Pyramid,
    decimate,
    extrema_by_bucket,
    level_for,
    width_s,
)

BOTH = slice(0, 2)


def by_hand(buckets, values, first, count):
    """Least and greatest of each bucket, the slow way."""
    low = np.full((count, values.shape[1]), np.nan)
    high = np.full((count, values.shape[1]), np.nan)
    for place in range(count):
        inside = values[buckets == first + place]
        if len(inside):
            low[place] = inside.min(axis=0)
            high[place] = inside.max(axis=0)
    return low, high


@settings(max_examples=40)
@given(st.integers(0, 2**32 - 1), st.integers(1, 200), st.integers(-5, 5))
def test_buckets_hold_what_numpy_finds(seed, samples, first):
    random = np.random.default_rng(seed)
    t_s = random.uniform(0.0, 0.02, samples)
    values = random.normal(size=(samples, 3))
    found = decimate(t_s, values, 1e-3, first, 12)
    low, high = by_hand(np.floor(t_s / 1e-3), values, first, 12)
    np.testing.assert_array_equal(found.low, low)
    np.testing.assert_array_equal(found.high, high)


def test_what_is_no_number_is_no_sample():
    places, extrema = extrema_by_bucket(np.array([3, 3, 5]), np.array([[1.0], [np.nan], [np.nan]]))
    np.testing.assert_array_equal(places, [3, 5])
    np.testing.assert_array_equal(extrema.low[:, 0], [1.0, np.nan])


@st.composite
def streams(draw, longest_gap_s):
    """Times in chunks, now and then with a gap, and now and then out of order by a little."""
    random = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    steps = random.exponential(1.0 / 5000.0, draw(st.integers(2, 1500)))
    gaps = random.integers(0, len(steps), draw(st.integers(0, 3)))
    steps[gaps] += random.uniform(0.0, longest_gap_s, len(gaps))
    t_s = np.abs(
        np.cumsum(steps) + random.normal(0.0, draw(st.sampled_from([0.0, 1e-4])), len(steps))
    )
    cuts = np.unique(random.integers(1, len(t_s), draw(st.integers(1, 30))))
    return t_s, random.normal(size=(len(t_s), 2)), np.split(np.arange(len(t_s)), cuts), random


REMEMBERED = st.one_of(
    st.tuples(streams(0.2), st.just(0)),
    st.tuples(streams(0.9), st.integers(1, 5)),
    st.tuples(streams(30.0), st.integers(6, 12)),
)
"""Streams with a level that remembers all of them: the finest a second, the next four."""


@settings(max_examples=40)
@given(REMEMBERED)
def test_no_peak_is_lost_at_any_level_however_the_samples_come(what):
    """Each bucket is asked for as soon as it is closed, as a page does; what was late counts
    where it came.
    """
    stream, level = what
    t_s, values, pieces, random = stream
    pyramid = Pyramid(2)
    sent = 0
    got = []
    for piece in pieces:
        pyramid.take(t_s[piece], values[piece], BOTH)
        pyramid.close_before(t_s[piece].max() - random.uniform(0.0, 0.01))
        got.append(
            pyramid.between(level, max(sent, pyramid.oldest(level)), pyramid.count_closed(level))
        )
        sent = pyramid.count_closed(level)
    pyramid.close_before(t_s.max() + 2 * width_s(level))
    got.append(
        pyramid.between(level, max(sent, pyramid.oldest(level)), pyramid.count_closed(level))
    )
    low = np.concatenate([part.low for part in got])
    high = np.concatenate([part.high for part in got])
    np.testing.assert_array_equal(np.nanmin(low, axis=0), values.min(axis=0))
    np.testing.assert_array_equal(np.nanmax(high, axis=0), values.max(axis=0))


@settings(max_examples=20)
@given(st.integers(0, 2**32 - 1), st.integers(0, 5))
def test_samples_in_their_order_fall_into_their_own_buckets(seed, level):
    random = np.random.default_rng(seed)
    t_s = np.cumsum(random.exponential(1.0 / 5000.0, 2000))
    values = random.normal(size=(2000, 2))
    pyramid = Pyramid(2)
    for piece in np.array_split(np.arange(2000), 17):
        pyramid.take(t_s[piece], values[piece], BOTH)
        pyramid.close_before(t_s[piece[-1]])
    count = pyramid.count_closed(level)
    found = pyramid.between(level, 0, count)
    low, high = by_hand((t_s / BASE_S).astype(int) >> level, values, 0, count)
    np.testing.assert_array_equal(found.low, low)
    np.testing.assert_array_equal(found.high, high)


def test_a_peak_that_comes_when_its_bucket_is_closed_counts_in_the_first_that_is_open():
    pyramid = Pyramid(1)
    pyramid.close_before(0.5)
    pyramid.take(np.array([0.1, 0.3]), np.array([[-9.0], [9.0]]), slice(0, 1))
    pyramid.close_before(0.6)
    found = pyramid.between(0, 1000, 1001)
    assert (found.low[0, 0], found.high[0, 0]) == (-9.0, 9.0)


def test_channels_that_come_one_after_the_other_share_their_buckets():
    pyramid = Pyramid(2)
    pyramid.take(np.array([0.0010]), np.array([[5.0]]), slice(0, 1))
    pyramid.take(np.array([0.0011]), np.array([[7.0]]), slice(1, 2))
    pyramid.close_before(0.01)
    np.testing.assert_array_equal(pyramid.between(0, 2, 3).low, [[5.0, 7.0]])


def test_memory_is_the_same_after_hours_and_the_coarse_levels_still_know_the_beginning():
    pyramid = Pyramid(1)
    for hour in range(5):
        pyramid.take(np.array([3600.0 * hour]), np.array([[float(hour)]]), slice(0, 1))
        pyramid.close_before(3600.0 * hour)
    pyramid.close_before(5 * 3600.0)
    level = level_for(5 * 3600.0)
    found = pyramid.between(level, 0, pyramid.count_closed(level))
    np.testing.assert_array_equal(found.high[~np.isnan(found.high)], [0.0, 1.0, 2.0, 3.0, 4.0])
    assert pyramid.oldest(0) == pyramid.count_closed(0) - (CAPACITY - AHEAD)


def test_what_nobody_remembers_is_a_gap():
    pyramid = Pyramid(1)
    pyramid.take(np.array([0.0]), np.array([[1.0]]), slice(0, 1))
    pyramid.close_before(100.0)
    assert np.isnan(pyramid.between(0, 0, 10).low).all()
    assert len(pyramid.between(0, 0, pyramid.count_closed(0)).low) == pyramid.count_closed(0)


@pytest.mark.parametrize(
    ("span_s", "dt_s"), [(0.1, 5e-4), (0.5, 5e-4), (0.6, 1e-3), (8.0, 8e-3), (3600.0, 4.096)]
)
def test_a_window_has_about_a_thousand_buckets(span_s, dt_s):
    assert width_s(level_for(span_s)) == pytest.approx(dt_s)


@settings(max_examples=15)
@given(st.integers(0, 2**32 - 1))
def test_a_leap_over_a_long_time_leaves_the_same_as_every_step_of_it(seed):
    random = np.random.default_rng(seed)
    leaping = Pyramid(1)
    stepping = Pyramid(1)
    at_s = 0.0
    for _ in range(4):
        at_s += random.choice([0.01, 1.0, 12.0])
        t_s = at_s + np.sort(random.uniform(0.0, 0.1, 20))
        values = random.normal(size=(20, 1))
        for pyramid in (leaping, stepping):
            pyramid.take(t_s, values, slice(0, 1))
        at_s = float(t_s[-1]) + random.choice([0.0, 8.0])
        for step_s in np.arange(float(t_s[0]), at_s, 0.3):
            stepping.close_before(step_s)
        for pyramid in (leaping, stepping):
            pyramid.close_before(at_s)
    for level in range(12):
        assert leaping.count_closed(level) == stepping.count_closed(level)
        begin = max(leaping.oldest(level), stepping.oldest(level))
        found, expected = (
            pyramid.between(level, begin, pyramid.count_closed(level))
            for pyramid in (leaping, stepping)
        )
        np.testing.assert_array_equal(found.low, expected.low)
        np.testing.assert_array_equal(found.high, expected.high)
