"""Pairs of the benchmarks beside a reference: what is drawn, recorded and marked."""

from dataclasses import asdict, replace

import numpy as np
import pytest

from tests.benchmarks import reference_any
from tests.benchmarks.changes import MarkedPair, is_first
from tests.benchmarks.reference_arm import ARM
from tests.benchmarks.reference_hopper import FRICTION, HOPPER, KINDS, MASS, SCALE, SOLE, record
from tests.benchmarks.reference_mechanism import (
    FORCE_STD,
    FRICTION_STD,
    NOTHING,
    Recording,
    draw_recording,
    mark,
)

SEED = 3
# What differs between the hopper before and after; zeros belong to the day.
CHANGED = {
    NOTHING: {"zero_m"},
    MASS: {"zero_m", "trunk_kg"},
    FRICTION: {"zero_m", "dry_N"},
    SCALE: {"zero_m", "force_factor"},
    SOLE: {"zero_m", "stiffness_N_per_m1p5"},
}


def answered(effects=(), family=None, rivals=()):
    """An answer with these stated effects, or this family."""
    return {
        "effects": {effect: {"probability": 0.95, "parameters": {}} for effect in effects},
        "family": None if family is None else {"id": family},
        "rivals": [[list(ids), 0.5] for ids in rivals],
    }


@pytest.mark.parametrize(
    ("right", "answer", "expected"),
    [
        ({"joint_friction"}, answered(["joint_friction"]), "effect"),
        ({"joint_friction", "added_mass"}, answered(["added_mass"]), "effect"),
        ({"joint_friction"}, answered(["joint_stribeck"]), "slot"),
        ({"joint_friction"}, answered(["joint_friction", "added_mass"]), "wrong"),
        ({"joint_friction"}, answered(["added_mass"]), "wrong"),
        ({"joint_friction"}, answered(family="joint_dissipation"), "slot"),
        ({"joint_friction"}, answered(family="body_mass"), "wrong"),
        ({"joint_friction"}, answered(), "silent"),
        (set(), answered(["joint_friction"]), "wrong"),
        (set(), answered(family="joint_dissipation"), "wrong"),
        (set(), answered(), "silent"),
    ],
)
def test_statements_are_marked(right, answer, expected):
    pair = MarkedPair(answer, frozenset(right), is_two=False, limits=0.0, size_errors=())
    assert pair.mark == expected


@pytest.mark.parametrize(
    ("right", "rivals", "expected"),
    [
        ({"joint_friction"}, [["joint_stribeck"], ["added_mass"]], True),
        # Without a statement the first set with an effect counts.
        ({"joint_friction"}, [[], ["unknown"], ["joint_friction"]], True),
        ({"joint_friction"}, [["added_mass"], ["joint_friction"]], False),
        ({"joint_friction"}, [[], ["unknown"]], False),
        (set(), [["joint_friction"]], False),
    ],
)
def test_the_most_probable_set_may_have_the_family(right, rivals, expected):
    said = answered(rivals=rivals)
    assert is_first(MarkedPair(said, frozenset(right), False, 0.0, ())) is expected


@pytest.mark.parametrize(("std_kg", "is_held"), [(0.1, True), (0.001, False)])
def test_sizes_are_compared_with_the_truth(std_kg, is_held):
    pair = HOPPER.draw(SEED, KINDS.index(MASS))
    added_kg = pair.after.trunk_kg - pair.before.trunk_kg
    said = answered(["added_mass"])
    said["effects"]["added_mass"]["parameters"] = {"mass_kg": [1.1 * added_kg, std_kg * added_kg]}
    ((error, held),) = mark(HOPPER, pair, said).size_errors
    assert error == pytest.approx(0.1)
    # 10 % are within 90 % of a normal error of 10 %, and not of one of 0.1 %.
    assert held == is_held


def test_a_change_is_what_its_kind_says():
    for number in range(2 * len(KINDS)):
        pair = HOPPER.draw(SEED, number)
        before = asdict(pair.before)
        after = asdict(pair.after)
        assert {name for name in before if before[name] != after[name]} == CHANGED[pair.kind]


@pytest.mark.parametrize("benchmark", [ARM, HOPPER], ids=lambda benchmark: benchmark.name)
def test_every_kind_has_other_motions_somewhere(benchmark):
    pairs = [benchmark.draw(SEED, number) for number in range(28)]
    assert {pair.kind for pair in pairs} == benchmark.right.keys()
    assert sum(pair.is_other for pair in pairs) in (6, 7)


def test_recordings_of_a_hopper_differ_in_what_is_their_own():
    hopper = HOPPER.draw(SEED, 0).before
    first = Recording(motion=7, noise=[1], friction=1.0, force=1.0)

    def measure_difference(**own):
        _, read, _, _ = record(hopper, replace(first, **own))
        return np.std(read[:, 0] - height)

    height = record(hopper, first)[1][:, 0]
    usual = np.std(height)
    assert measure_difference() == 0.0
    assert measure_difference(noise=[2]) == pytest.approx(
        np.sqrt(2.0) * hopper.position_error_m, rel=0.1
    )
    assert 1e-4 * usual < measure_difference(friction=1.03) < 0.05 * usual
    assert 1e-4 * usual < measure_difference(force=1.003) < 0.05 * usual
    assert measure_difference(motion=8) > 0.3 * usual


def test_repeats_have_noise_friction_and_force_of_their_own():
    first = draw_recording(7, [0, 7, 0])
    repeat = draw_recording(7, [0, 7, 1])
    assert first.motion == repeat.motion
    assert first.noise != repeat.noise
    assert 0.0 < abs(first.friction - repeat.friction) < 6.0 * FRICTION_STD
    assert 0.0 < abs(first.force - repeat.force) < 6.0 * FORCE_STD


@pytest.mark.parametrize(
    ("kind", "name", "effects", "family", "expected"),
    [
        ("listed", "tip_mass", ("tip_mass",), None, "right"),
        ("listed", "tip_mass", (), "leg_mass", "family"),
        ("listed", "ground_compliance", ("contact_stiffness_change",), None, "family"),
        ("listed", "tip_mass", ("tip_mass", "sensor_gain"), None, "wrong"),
        ("listed", "tip_mass", (), None, "silent"),
        # Of a fault outside the catalogue only its family can be right.
        ("unlisted", "tendon", ("k0_change",), None, "family"),
        ("unlisted", "tendon", (), "hinge_stiffness", "family"),
        ("unlisted", "tendon", ("sensor_gain",), None, "wrong"),
        ("unlisted", "hose_at_the_shaft", (), "hinge_stiffness", "wrong"),
    ],
)
def test_a_change_of_any_kind_is_marked_by_what_it_is(kind, name, effects, family, expected):
    said = {**answered(effects, family), "kind": kind, "name": name}
    assert reference_any.mark(said) == expected


def test_every_second_change_is_outside_the_catalogue_and_the_rest_stays():
    for number, kind in enumerate((reference_any.LISTED, reference_any.UNLISTED) * 3):
        drawn, name, strength, before, after = reference_any.draw(SEED, number)
        assert drawn == kind
        assert reference_any.LEAST_STRENGTH <= strength <= 1.0
        changed = after.strangers if kind == reference_any.UNLISTED else after.effects
        assert name in changed
        assert name not in before.strangers
        assert replace(after, seed=0, effects={}, strangers={}, law=None) == replace(
            before, seed=0, effects={}, strangers={}, law=None
        )
