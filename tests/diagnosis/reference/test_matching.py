"""A command is recognised by the course of its motion, at the same times."""

import numpy as np

from rfca_rig.diagnosis.reference.matching import find_matches, find_repeats, name_signals
from tests.diagnosis.reference.observations import BIN_S, motion, recording, stack

REFERENCE = stack(
    recording("a 1", motion()),
    recording("b 1", motion(1.6)),
    recording("a 2", motion() + 0.01),
)


def test_the_same_motion_matches_all_its_repeats_at_the_same_times():
    matches = find_matches(recording("new", motion() + 0.02), REFERENCE, name_signals)
    names = [REFERENCE.labels[REFERENCE.label[match.rows[0]]].recording for match in matches]
    assert names == ["a 1", "a 2"]
    for match in matches:
        assert np.abs(REFERENCE.t_s[match.rows] - BIN_S * np.arange(len(match.rows))).max() < 1e-9
        assert match.distance < 0.05


def test_another_motion_of_the_same_name_does_not_match():
    assert not find_matches(recording("a 1", motion(0.8)), REFERENCE, name_signals)


def test_a_smaller_motion_does_not_match_beside_large_ones():
    reference = stack(recording("large", motion(1.6, 30.0)), recording("small", motion()))
    (match,) = find_matches(recording("new", motion()), reference, name_signals)
    assert reference.labels[reference.label[match.rows[0]]].recording == "small"
    assert not find_matches(recording("new", motion(0.0, 2.0)), reference, name_signals)


def test_the_same_motion_at_other_times_does_not_match():
    assert not find_matches(
        recording("new", motion(), start_s=0.6 * BIN_S), REFERENCE, name_signals
    )
    assert not find_matches(recording("new", motion(), start_s=30.0), REFERENCE, name_signals)


def test_repeats_are_recordings_of_one_motion():
    (group,) = find_repeats(REFERENCE, name_signals)
    names = {REFERENCE.labels[REFERENCE.label[match.rows[0]]].recording for match in group}
    assert names == {"a 1", "a 2"}
    first, second = group
    assert np.array_equal(REFERENCE.t_s[first.rows], REFERENCE.t_s[second.rows])


def test_without_repeats_there_is_no_group():
    assert not find_repeats(
        stack(recording("a", motion()), recording("b", motion(1.6))), name_signals
    )
