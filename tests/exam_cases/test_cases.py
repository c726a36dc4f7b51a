"""The list of cases: reproducible, of every kind, and within what is plausible."""

from collections import Counter
from dataclasses import replace

import numpy as np
import pytest

from rfca_rig.exam import cases
from rfca_rig.exam.cases import (
    DEFAULT_NUMBERS,
    KINDS,
    NEVER_TOGETHER,
    SIZE_RANGES,
    UNKNOWN_FAULT_RANGES,
    draw_cases,
    split_numbers,
)
from rfca_rig.exam.hidden_laws import MISLABELLED, NAMES
from rfca_rig.exam.sampled_rig import EFFECTS, ExamScatter, build_world, with_effect
from rfca_rig.exam.truth import measure_visibility
from rfca_rig.model.catalogue import catalogue


def test_the_exam_is_large_enough():
    drawn = Counter(case.kind for case in draw_cases(1))
    assert sum(drawn.values()) >= 400
    for kind in (
        cases.NOTHING,
        cases.MODEL_ERROR,
        cases.SINGLE,
        cases.PAIR,
        cases.STRANGER,
        cases.WRONG_LAW,
    ):
        assert drawn[kind] >= 60


def test_same_seed_same_cases_other_seed_others():
    assert draw_cases(7) == draw_cases(7)
    assert draw_cases(7) != draw_cases(8)


def test_a_case_does_not_depend_on_how_many_there_are():
    few, many = (draw_cases(3, {cases.SINGLE: n}) for n in (5, 50))
    assert {case.seed for case in few} <= {case.seed for case in many}


def test_every_effect_at_every_level():
    drawn = Counter(
        (next(iter(case.effects)), int(5 * case.strength))
        for case in draw_cases(1)
        if case.kind == cases.SINGLE
    )
    assert len(drawn) == 5 * len(EFFECTS) and set(drawn.values()) == {1}


def test_pairs_are_pairs_that_a_model_can_hold():
    for case in draw_cases(2, {cases.PAIR: 200}):
        assert len(case.effects) == 2
        assert set(case.effects) not in NEVER_TOGETHER


def test_cases_without_effects_have_none():
    legs = [case for case in draw_cases(4) if case.kind in cases.LEG_KINDS]
    for case in legs:
        if case.kind in (cases.NOTHING, cases.MODEL_ERROR, cases.MISLABEL):
            assert not case.effects and not case.strangers
        assert (case.structured is not None) == (case.model_error > 0.0)


def test_numbers_are_shared_out_exactly():
    for total in (1, 8, 40, 123):
        assert sum(split_numbers(total).values()) == total
    assert split_numbers(sum(DEFAULT_NUMBERS.values())) == DEFAULT_NUMBERS


def test_effects_and_parameters_are_those_of_the_catalogue():
    known = catalogue()
    for effect, spans in SIZE_RANGES.items():
        parameters = {parameter.name: parameter for parameter in known[effect].parameters}
        assert set(spans) == {name for name, parameter in parameters.items() if not parameter.whole}
        for name, span in spans.items():
            for size in (span.faint, span.strong):
                if span.either_sign:
                    values = {span.around + size, span.around - size}
                else:
                    values = {size}
                assert all(
                    parameters[name].low <= value <= parameters[name].high for value in values
                ), (effect, name)


def test_strangers_are_in_no_catalogue_and_all_have_sizes():
    assert set(NAMES) == set(UNKNOWN_FAULT_RANGES) and len(NAMES) >= 10
    assert not set(NAMES) & set(catalogue())


@pytest.mark.long
@pytest.mark.parametrize("name", NAMES)
def test_every_stranger_shows(name):
    case = next(
        case for case in draw_cases(5, {cases.STRANGER: len(NAMES)}) if name in case.strangers
    )
    assert measure_visibility(case).shift > 0.5


@pytest.mark.parametrize("said", MISLABELLED)
def test_every_wrong_label_changes_what_is_written_or_what_is(said):
    from rfca_rig.exam.hidden_laws import columns_as_written, speed_as_written, true_world

    case = draw_cases(1, {cases.NOTHING: 1})[0]
    world = build_world(case, 0.215, ExamScatter(), 1)
    columns = {"fy_N": np.array([1.0]), "fz_N": np.array([2.0]), "tx_Nm": np.array([3.0])}
    changed = (
        true_world(world, said) != world,
        columns_as_written(columns, said) != columns,
        speed_as_written(2.0, (2.0, 3.0), said) != 2.0,
    )
    assert sum(changed) == 1


@pytest.mark.long
def test_strength_is_what_shifts_the_forces():
    sizes = []
    for level in range(5):
        case = next(
            case
            for case in draw_cases(1)
            if case.kind == cases.SINGLE
            and "hinge_backlash" in case.effects
            and int(5 * case.strength) == level
        )
        sizes.append(measure_visibility(case).shift)
    assert sizes == sorted(sizes)


@pytest.mark.slow
def test_what_believed_values_can_imitate_is_hardly_left():
    """A little more damping is within what damping is known to; play is not."""
    case = replace(draw_cases(1, {cases.SINGLE: 1})[0], design=cases.ONE_STROKE)
    soft = measure_visibility(
        replace(case, effects={"hinge_viscous_damping": {"coefficient_Nm_s_per_rad": 0.03}})
    )
    play = measure_visibility(replace(case, effects={"hinge_backlash": {"half_gap_deg": 0.8}}))
    assert soft.left < 0.2 * soft.shift and play.left > 4.0
    assert soft.above < soft.left and 1.0 < play.above < play.left


def test_kinds_are_distinct_words():
    assert len(set(KINDS)) == len(KINDS) == len(DEFAULT_NUMBERS)


def test_an_unknown_effect_is_refused():
    from rfca_rig.errors import BadInput

    with pytest.raises(BadInput, match="nonsense"):
        with_effect(
            build_world(draw_cases(1, {cases.NOTHING: 1})[0], 0.215, ExamScatter(), 1),
            "nonsense",
            {},
        )
