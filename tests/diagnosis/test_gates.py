"""Gates and decoys, on rivals built by hand."""

from dataclasses import replace

import numpy as np
import pytest

from rfca_rig.diagnosis.decision import acceptance as gates
from rfca_rig.diagnosis.decision.acceptance import (
    APPROXIMATELY,
    MOST_VARIATION,
    _least_left,
    _most_variation,
    comes_down,
    share_by_size,
    vetoed,
)
from rfca_rig.diagnosis.decision.negative_controls import best_decoy, taken_away
from rfca_rig.diagnosis.inference.map_fit import GaussNewton
from rfca_rig.diagnosis.inference.parameterization import EffectTerm
from rfca_rig.diagnosis.inference.screening import EffectProbe
from rfca_rig.model.catalogue import catalogue
from tests.diagnosis.by_hand import RIG, flaps_of, found_among, present, recorded

CONDITIONS = [(205.0, 2.4), (220.0, 2.9)]


@pytest.fixture(scope="module")
def played():
    """A leg whose hinges have play, and a search for just that."""
    rig = replace(RIG, effects=(present("hinge_backlash", half_gap_deg=0.8),))
    return found_among(flaps_of(recorded(rig, CONDITIONS)), ["hinge_backlash"])


def with_trial(found, signature):
    choice = EffectTerm(catalogue()["hinge_backlash"])
    return replace(found, trials=(EffectProbe(choice, np.zeros(1), signature),))


def test_what_a_true_effect_takes_away_is_nearly_all_and_a_turned_channel_takes_less(played):
    best = played.named[0]
    signature = best.rows - played.nothing.rows
    own = taken_away(played, best, played.nothing)
    assert own > 500.0
    assert best_decoy(with_trial(played, signature), best, played.nothing) < 0.5 * own


def test_a_decoy_that_says_what_the_effect_says_is_none(played):
    """A signature in one channel alone is only reversed by turning another one about."""
    best = played.named[0]
    signal = played.evidence.rows.signal
    alone = np.where(signal == "fz_N", best.rows - played.nothing.rows, 0.0)
    only_fz = replace(best, fitted=replace(best.fitted, predicted=best.fitted.predicted + alone - (best.rows - played.nothing.rows)))
    assert best_decoy(with_trial(played, alone), only_fz, played.nothing) == 0.0


def test_conditions_count_by_how_much_they_change():
    assert share_by_size(np.array([1.0, 1.0, -0.05, -0.05])) == pytest.approx(2.0 / 2.1)
    assert share_by_size(np.array([1.0, -1.0])) == pytest.approx(0.5)
    assert share_by_size(np.zeros(3)) == 0.0


SMALL = 0.15  # by which chance may make a condition come out worse


@pytest.mark.parametrize(
    ("before", "after", "is_vetoed"),
    [
        ([4.0, 3.0, 0.7], [0.5, 0.4, 0.9], False),  # worse by more than chance, and still foretold as well as models do
        ([4.0, 3.0, 0.7], [0.5, 0.4, 1.1], True),
        ([4.0, 3.0, 1.0], [0.5, 0.4, 1.1], False),
        ([0.6, 0.5, 0.3], [0.3, 0.3, 0.5], True),  # without the effect the model errs no more than models do
        ([0.6, 0.5, 0.3], [0.3, 0.3, 0.4], False),
    ],
)
def test_a_condition_that_comes_out_worse_is_a_veto_unless_it_is_foretold_well_all_the_same(before, after, is_vetoed):
    assert vetoed(np.array(before), np.array(after), np.full(3, SMALL)) == is_vetoed


def test_chance_does_more_to_a_condition_of_few_rows(played):
    rows = np.bincount(played.evidence.rows.condition)
    assert gates._floor(played) == pytest.approx(3.0 / np.sqrt(2.0 * rows))
    few = replace(played.evidence.rows, condition=np.repeat([0, 1], [rows.sum() - 72, 72]))
    assert gates._floor(replace(played, evidence=replace(played.evidence, rows=few)))[1] == pytest.approx(0.25)


@pytest.mark.parametrize(
    ("before", "after", "is_down"),
    [
        (2.4, 0.6, True),
        (2.4, 1.3, False),  # a filter that passes for a late clock
        (1.43, 0.8, False),  # a spring that relaxes, for one with hysteresis
        (2.4, 0.95, True),
        (1.48, 0.74, False),
        (1.48, 0.67, True),  # nothing missing would almost do, and nearly all of it is taken
        (0.9, 0.64, True),
        (0.9, 0.66, False),
        (0.7, 0.5, True),  # better than a good model has to be
    ],
)
def test_a_name_comes_down_to_what_good_models_leave(before, after, is_down):
    assert comes_down(before, after, 0.63) == is_down


@pytest.mark.parametrize(
    ("before", "relieves", "passed"),
    [
        (0.9, True, True),  # a soft floor that a contact four deviations from believed stands for
        (0.9, False, False),
        (1.2, True, False),  # with the same share taken away, something is missing that the name does not explain
    ],
)
def test_where_a_believed_value_hides_what_is_missing_a_name_need_not_take_much_away(played, monkeypatch, before, relieves, passed):
    best = played.named[0]
    rms = {id(best): np.full(3, 0.7 * before), id(played.nothing): np.full(3, before)}
    monkeypatch.setattr(gates, "left_out", lambda _, hypothesis: rms[id(hypothesis)])
    monkeypatch.setattr(gates, "_relieves", lambda *_: relieves)
    monkeypatch.setattr(gates, "_floor", lambda _: np.full(3, SMALL))
    assert gates._foretold(played, best).passed == passed


def test_the_best_of_models_leave_the_noise_and_half_of_the_usual_error(played):
    assert 0.5 < _least_left(played) < 1.0
    usual_alone = replace(played.judge, named=(played.judge.usual,))
    assert _least_left(replace(played, judge=usual_alone)) == 1.0


def test_what_only_slopes_promise_does_not_count(played):
    """A slope that leads away from the best point promises a better fit; no step along it finds one."""
    best = played.named[0].fitted
    descent = GaussNewton(played.evidence, played.judge)
    honest = descent.evaluate(best)
    assert honest.log_evidence == pytest.approx(played.named[0].judgement.log_evidence, abs=1.0)
    worse = descent.at(best.coordinates, best.x + 0.4 * (np.arange(len(best.x)) == best.coordinates.nuisances), best.jacobian)
    assert worse is not None
    linear = worse.linear(played.evidence.rows.measured)
    assert played.judge.evaluate(linear).log_evidence > descent.evaluate(worse).log_evidence + 20.0


def test_an_approximate_law_is_enough_only_where_something_is_missing_for_sure(played):
    assert _most_variation(played) == APPROXIMATELY
    believed = replace(played, nothing=replace(played.nothing, fitted=played.named[0].fitted))
    assert _most_variation(believed) == MOST_VARIATION < APPROXIMATELY
