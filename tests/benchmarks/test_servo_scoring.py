"""Scoring of the benchmark of servos, on answers written by hand."""

import numpy as np
import pytest

from tests.benchmarks.servo import (
    ARM,
    NOTHING,
    WEIGHT,
    choose_kind,
    draw,
    excluded_truth,
    find_limit,
    implied_change,
    is_in_interval,
    mark,
)

BEFORE = {"mass_kg": 1.0, "centre_m": 0.1, "gravity_Nm": 0.981}
AFTER = {"mass_kg": 1.2, "centre_m": 0.1, "gravity_Nm": 1.1772}


def answered(kind=WEIGHT, grade="mostly", effects=None, family="", not_seen=None):
    """An answer about a weight of 1 kg that became 1.2 kg, or stayed."""
    stated = {}
    for name, parameters in (effects or {}).items():
        stated[name] = {"probability": 0.95, "parameters": parameters}
    return {
        "kind": kind,
        "grade": grade,
        "effects": stated,
        "family": {"id": family} if family else None,
        "not_seen": not_seen or {},
        "nominal": BEFORE,
        "truth": {"before": BEFORE, "after": BEFORE if kind == NOTHING else AFTER},
    }


ADDED = {"added_mass": {"body": [1.0, 0.0], "mass_kg": [0.22, 0.02]}}


@pytest.mark.parametrize(
    ("answer", "expected"),
    [
        (answered(effects=ADDED), "right"),
        (answered(effects=ADDED | {"joint_load_friction": {}}), "right"),
        (answered(effects=ADDED | {"gear_backlash": {}}), "wrong"),
        (answered(effects={"joint_load_friction": {}}), "wrong"),
        (answered(grade="family", family="body_mass"), "family"),
        (answered(grade="family", family="gear_yields"), "wrong"),
        (answered(grade="family", family="a family to come"), "wrong"),
        (answered(grade="unexplained"), "silent"),
        (answered(grade="refused"), "silent"),
        (answered(NOTHING, "nothing missing"), "right"),
        (answered(NOTHING, "unexplained"), "silent"),
        (answered(NOTHING, effects={"joint_load_friction": {}}), "law of the servo"),
        (answered(NOTHING, "family", family="joint_dissipation"), "law of the servo"),
        (answered(NOTHING, effects=ADDED), "wrong"),
    ],
)
def test_marks(answer, expected):
    assert mark(answer) == expected


def test_a_stated_mass_implies_a_torque_with_its_interval():
    change_Nm, std_Nm = implied_change(answered(effects=ADDED))
    assert change_Nm == pytest.approx(9.81 * 0.1 * 0.22)
    assert std_Nm == pytest.approx(9.81 * 0.1 * 0.02)
    assert is_in_interval(answered(effects=ADDED)) is True
    narrow = {"added_mass": {"mass_kg": [0.22, 0.01]}}
    assert is_in_interval(answered(effects=narrow)) is False
    assert is_in_interval(answered(effects={"joint_load_friction": {}})) is None


def test_a_stated_lever_implies_a_torque_as_well():
    shifted = answered(effects={"centre_of_mass": {"shift_m": [0.02, 0.001]}})
    change_Nm, std_Nm = implied_change(shifted)
    assert change_Nm == pytest.approx(9.81 * 1.0 * 0.02)
    assert std_Nm == pytest.approx(9.81 * 1.0 * 0.001)


def test_an_exclusion_from_less_than_the_truth_contains_it():
    assert "added_mass" in excluded_truth(answered(not_seen={"added_mass": {"mass_kg": 0.1}}))
    assert excluded_truth(answered(not_seen={"added_mass": {"mass_kg": 0.3}})) == ""
    assert excluded_truth(answered(not_seen={"added_mass": None})) == ""


def test_the_limit_is_the_median_of_unchanged_pairs():
    limits_kg = [0.05, 0.1, 0.4]
    answers = []
    for limit_kg in limits_kg:
        not_seen = {"added_mass": {"mass_kg": limit_kg}}
        answers.append(answered(NOTHING, not_seen=not_seen))
    answers.append(answered(WEIGHT, not_seen={"added_mass": {"mass_kg": 9.0}}))
    assert find_limit(answers)[0] == pytest.approx(0.1)


def test_of_forty_pairs_twelve_are_unchanged():
    kinds = [choose_kind(number) for number in range(40)]
    assert [kinds.count(kind) for kind in (NOTHING, WEIGHT, ARM)] == [12, 14, 14]
    sizes = []
    for number in range(40):
        pair = draw(1, number)
        ratio = pair.changed.gravity_Nm / pair.reference.gravity_Nm
        assert pair.changed.gravity_Nm < 0.7 * pair.reference.motor.stall_Nm
        assert (ratio == 1.0) == (pair.kind == NOTHING)
        sizes.append(ratio - 1.0)
    assert np.max(sizes) < 1.5
    assert np.min(sizes) > -0.5
