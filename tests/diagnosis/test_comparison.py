"""What supports a statement: the best explanation, its rivals, scatter between conditions,
strained values, and sizes.
"""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.special import logsumexp

from rfca_rig.diagnosis.config import (
    AS_GOOD_LOG_ODDS,
    IMPLAUSIBLE,
    LARGE_ERROR,
    LAW_ERROR,
    LAW_SIZE_ERROR,
    MAX_COORDINATE,
    USUAL_MISFIT,
)
from rfca_rig.diagnosis.decision import decide, families, sizes
from rfca_rig.diagnosis.decision.comparison import Comparison, _without_unconfirmed, compare
from rfca_rig.diagnosis.decision.decide import decide_from
from rfca_rig.diagnosis.decision.decision import Supported
from rfca_rig.diagnosis.decision.families import (
    _find_family_alike,
    find_best_family,
    find_other_families,
    list_families,
    name_families,
    support_of_best,
)
from rfca_rig.diagnosis.decision.sizes import estimate_sizes, widen
from rfca_rig.diagnosis.likelihood.covariance import discrepancy_covariance
from rfca_rig.diagnosis.result import StatedFamily, Value
from rfca_rig.diagnosis.result_builder import describe
from rfca_rig.model.catalogue import catalogue, members_of
from rfca_rig.model.effect import EqualLimit, Parameter
from tests.diagnosis.by_hand import KNOWN_TO, RIG, flaps_of, found_among, present, recorded

CONDITIONS = [(205.0, 2.0), (215.0, 2.4), (230.0, 3.0), (210.0, 2.2), (222.0, 2.7)]
GAIN = 1.2
ALONE = {"law_error_without": 1.0}  # support of an effect without which nothing is explained


def compared(rigs, rivals, known_to=KNOWN_TO) -> Comparison:
    """Each condition recorded on its own rig."""
    strokes = [
        stroke
        for rig, condition in zip(rigs, CONDITIONS, strict=True)
        for stroke in recorded(rig, [condition], with_shaft=False)
    ]
    return compare(found_among(flaps_of(strokes), rivals, known_to))


def with_effect(name, **values):
    return replace(RIG, effects=(present(name, **values),))


@pytest.fixture(scope="module")
def gained():
    return compared(
        [with_effect("sensor_gain", factor=GAIN)] * 5, ["sensor_gain", "sensor_crosstalk"]
    )


@pytest.fixture(scope="module")
def uneven():
    """A gain that differs from condition to condition: no law of the catalogue."""
    return compared(
        [with_effect("sensor_gain", factor=factor) for factor in (1.3, 1.33, 1.27, 1.33, 1.27)],
        ["sensor_gain", "sensor_crosstalk"],
    )


def strained(one, x):
    """The hypothesis with its first nuisance parameter so many prior deviations away, and exact
    laws; all others at their prior means.
    """
    fitted = one.hypothesis.fitted
    return moved(
        one,
        np.concatenate([[x], fitted.at_prior_means[1:]]),
        np.append(x, np.zeros(fitted.coordinates.nuisances - 1)),
    )


def moved(one, x, nuisance_shifts):
    """The hypothesis at other values of its unknowns, with the signatures that it had."""
    other = replace(
        one, hypothesis=replace(one.hypothesis, fitted=replace(one.hypothesis.fitted, x=x))
    )
    other.__dict__.update(signatures=one.signatures, nuisance_shifts=nuisance_shifts)
    return other


@pytest.mark.slow
def test_a_law_that_holds_has_one_size_everywhere_and_leaves_noise(gained):
    support = gained.support(("sensor_gain",))
    assert gained.best.ids == ("sensor_gain",)
    assert gained.explained_share(gained.best) > 0.95 and support.held_out_ratio > 1.0
    assert gained.best.scale < 0.01 < gained.nothing.scale
    assert gained.law_error(gained.best) < 0.2


@pytest.mark.slow
def test_a_law_that_does_not_hold_explains_less_and_leaves_misfit(uneven, gained):
    assert uneven.best.ids == ("sensor_gain",)
    assert uneven.explained_share(uneven.best) < 0.8 < gained.explained_share(gained.best)
    assert uneven.law_error(uneven.best) > 5.0 * gained.law_error(gained.best)


def test_relief_is_what_the_rival_asks_of_the_nuisance_parameters_beyond_the_best(gained):
    ranked = tuple(
        strained(one, 3.0 if one.ids == ("sensor_gain",) else 5.0) for one in gained.ranked
    )
    comparison = Comparison(gained.result, ranked)
    rest = comparison.without(("sensor_gain",)).hypothesis.fitted.at_prior_means[1:]
    assert not rest[: rest.size - 1].any()
    assert comparison.support(("sensor_gain",)).relief == pytest.approx(4.0)
    swapped = tuple(
        strained(one, 5.0 if one.ids == ("sensor_gain",) else 3.0) for one in gained.ranked
    )
    assert Comparison(gained.result, swapped).support(("sensor_gain",)).relief == 0.0


def test_evidence_is_the_smaller_one_of_a_free_and_of_a_large_model_error(gained):
    """Behind by 50 at small errors alone, and by 2 where the model errs by LARGE_ERROR."""
    rival = gained.without(("sensor_gain",))
    scales = np.array([whitening.s for whitening in gained.result.likelihood.every_scale])
    behind = np.where(scales < LARGE_ERROR, 50.0, 2.0)
    best = replace(
        gained.best, log_evidence=rival.log_evidence + behind, log_joint=rival.log_joint + 45.0
    )
    others = [one for one in gained.ranked if one is not gained.best]
    found = Comparison(gained.result, (best, *others)).support(("sensor_gain",)).log_bayes_factor
    free = float(logsumexp(best.log_evidence) - logsumexp(rival.log_evidence))
    assert free > 40.0 and found == pytest.approx(45.0 - free + 2.0)


def test_a_shift_that_the_error_of_an_approximate_law_would_cause_counts_less(gained):
    """By dense matrices: the gain of the linear fit times a smooth error of LAW_ERROR of the
    signature.
    """
    rows = gained.result.dataset.rows
    fitted = gained.best.hypothesis.fitted
    x = np.concatenate([[3.5, -MAX_COORDINATE], fitted.x[2:]])
    one = replace(
        gained.best, hypothesis=replace(gained.best.hypothesis, fitted=replace(fitted, x=x))
    )
    one.__dict__["signatures"] = gained.best.signatures
    inverse = np.linalg.inv(one.whitening.covariance())
    jacobian = fitted.jacobian
    gain = np.linalg.solve(jacobian.T @ inverse @ jacobian + np.eye(x.size), jacobian.T @ inverse)
    correlation = discrepancy_covariance(rows) / np.outer(rows.scale, rows.scale)
    np.fill_diagonal(correlation, 1.0)
    error = LAW_ERROR * gained.best.signatures[0]
    expected = np.sqrt(1.0 + np.diag(gain @ (np.outer(error, error) * correlation) @ gain.T))
    mean = gain @ (rows.measured - fitted.predicted + jacobian @ x)
    assert expected[:2].min() > 1.02  # so that the test can fail
    assert one.nuisance_shifts[0] == pytest.approx(3.5 / expected[0], rel=1e-6)
    # Where the optimiser was stopped, the linear fit tells how much farther the shift would go.
    assert one.nuisance_shifts[1] == pytest.approx(
        max((x[1], mean[1]), key=abs) / expected[1], rel=1e-6
    )
    assert np.array_equal(gained.nothing.nuisance_shifts, gained.nothing.hypothesis.fitted.x)


def test_what_an_exact_law_removes_beside_its_rival_is_nearly_all_that_can_be_removed(
    gained, uneven
):
    assert gained.support(("sensor_gain",)).removed_share > 0.95
    assert 0.3 < uneven.support(("sensor_gain",)).removed_share < 0.95


@pytest.mark.parametrize(("z", "grade"), [(3.9, "identified"), (-MAX_COORDINATE, "family")])
def test_of_a_law_at_the_end_of_its_range_only_the_family_is_stated(gained, z, grade):
    at_end = moved(
        gained.best, np.append(gained.best.hypothesis.fitted.x[:-1], z), gained.best.nuisance_shifts
    )
    comparison = Comparison(
        gained.result, tuple(at_end if one is gained.best else one for one in gained.ranked)
    )
    sure = [replace(one, probability=0.95) for one in support_of_best(comparison)]
    assert decide_from(comparison, sure).grade == grade


def test_an_effect_that_relieves_an_implausible_value_is_not_dropped(gained):
    """The simpler set predicts held-out conditions as well, but only with a value that nobody
    would believe.
    """
    best = strained(gained.best, 1.0)
    nothing = {
        x: _with_rms(strained(gained.nothing, x), best.held_out_rms)
        for x in (1.0, IMPLAUSIBLE + 0.5)
    }
    dropped, kept = (Comparison(gained.result, (best, simpler)) for simpler in nothing.values())
    assert dropped.best.ids == () and kept.best.ids == ("sensor_gain",)


def _with_rms(one, rms):
    """The hypothesis as if held-out conditions were predicted to this rms."""
    one.__dict__["held_out_rms"] = rms
    return one


def test_a_size_counts_from_where_the_effect_does_nothing(gained):
    """The law leaves a share of what a gain of 1.2 changes, not of 1.2."""
    factor = estimate_sizes(gained, gained.best.hypothesis, 0)[0]["factor"]
    assert abs(factor.value - GAIN) < 2.0 * factor.std
    assert LAW_SIZE_ERROR * (GAIN - 1.0) * 0.9 < factor.std < LAW_SIZE_ERROR * GAIN


def test_intervals_widen_with_what_the_law_leaves(uneven, gained):
    narrow, wide = (
        estimate_sizes(one, one.best.hypothesis, 0)[0]["factor"].std for one in (gained, uneven)
    )
    assert wide > 3.0 * narrow
    assert wide > 0.02  # the gains were 1.27 to 1.33


def test_two_estimates_of_one_deviation_are_not_added(gained, monkeypatch):
    """With a jackknife as wide as the posterior, and a law that leaves nothing, an interval is
    as wide as either.
    """
    hypothesis = gained.best.hypothesis
    posterior_std = np.sqrt(np.diag(hypothesis.marginal.posterior.covariance))
    monkeypatch.setattr(sizes, "LAW_SIZE_ERROR", 0.0)
    monkeypatch.setattr(sizes, "LAW_MISFIT_SHARE", 0.0)
    std = []
    for share in (0.0, 1.0, 3.0):
        monkeypatch.setattr(sizes, "_jackknife_std", lambda *_, share=share: share * posterior_std)
        std.append(estimate_sizes(gained, hypothesis, 0)[0]["factor"].std)
    assert std[1] == std[0] > 0.0
    assert std[2] == pytest.approx(3.0 * std[0], rel=0.05)


def test_a_family_is_at_least_as_probable_as_an_effect_whose_class_it_holds(gained, monkeypatch):
    monkeypatch.setattr(
        families,
        "calibration_of",
        lambda kind: SimpleNamespace(probability=lambda _: {"effect": 0.9, "family": 0.6}[kind]),
    )
    probability = {one.kind: one.probability for one in support_of_best(gained)}
    assert probability == {"effect": 0.9, "family": 0.9}
    monkeypatch.setattr(Comparison, "as_good_as", lambda *_: ("clock_offset",))
    assert {one.probability for one in support_of_best(gained) if one.kind == "family"} == {0.6}


def graded(comparison, of_effects, of_families=0.5):
    """The decision had the calibration given these probabilities."""
    probability = {"effect": of_effects, "family": of_families}
    return decide_from(
        comparison,
        [replace(one, probability=probability[one.kind]) for one in support_of_best(comparison)],
    )


def test_a_law_that_holds_is_identified_and_one_that_does_not_mostly(gained, uneven):
    exact = graded(gained, 0.95)
    mostly = graded(uneven, 0.95)
    assert (exact.grade, mostly.grade) == ("identified", "mostly")
    assert [effect.id for effect in mostly.effects] == [
        "sensor_gain"
    ] and mostly.probability == 0.95
    assert [criterion.name for criterion in mostly.criteria if not criterion.passed] == [
        "held-out misfit"
    ]


def test_what_is_stated_needs_no_reason_and_what_is_not_has_one(gained):
    assert graded(gained, 0.95).not_stated == {}
    unsure = graded(gained, 0.4)
    assert not unsure.effects
    assert unsure.not_stated == {
        "sensor_gain": "its calibrated probability is 0.40, and 0.8 is needed"
    }


@pytest.mark.parametrize(
    ("changes", "reason"),
    [
        ({"probability": 0.7}, "its calibrated probability is 0.70, and 0.8 is needed"),
        ({"is_at_bound": True}, "its size is at the end of its plausible range"),
        (
            {"values": {"law_error_without": 0.01, "removed_share": 0.5}},
            "without it the other laws leave no more than approximate laws usually do",
        ),
        ({}, ""),
    ],
)
def test_each_reason_against_an_effect_is_said(changes, reason):
    effect = replace(Supported("effect", "sensor_gain", 0.95, ALONE), **changes)
    objection = decide._object_to(effect, 0.8, is_unsure=False, is_denied=False)
    assert objection.startswith(reason) and bool(objection) == bool(reason)


def test_a_family_that_is_as_good_and_a_denying_table_are_reasons():
    effect = Supported("effect", "sensor_gain", 0.95, ALONE)
    unsure = decide._object_to(effect, 0.8, is_unsure=True, is_denied=False)
    assert unsure == "fewer laws of its family explain these data nearly as well"
    denied = decide._object_to(effect, 0.8, is_unsure=False, is_denied=True)
    assert "nothing missing more than one half" in denied


@pytest.mark.parametrize(("of_effects", "of_families"), [(0.95, 0.95), (0.5, 0.95)])
def test_nothing_is_stated_that_the_table_denies(uneven, of_effects, of_families):
    assert graded(uneven, of_effects, of_families).grade in ("mostly", "family")
    nothing = uneven.result.nothing
    log_evidence = uneven.best.log_joint + 1.0 - nothing.log_prior
    raised = replace(nothing, marginal=replace(nothing.marginal, log_evidence=log_evidence))
    denied = Comparison(replace(uneven.result, nothing=raised), uneven.ranked)
    decision = graded(denied, of_effects, of_families)
    assert decision.grade == "unexplained"
    assert not decision.effects and decision.family is None
    assert decision.probability < 0.5
    assert describe(decision) == (
        "More probably than not nothing is missing, though the recordings differ from the model "
        f"by more than usual: sensor_gain ({100.0 * decision.probability:.0f} %)."
    )


def test_what_relieves_an_implausible_value_is_stated_though_it_removes_little(gained):
    """Without the effect, held-out conditions are predicted as well, by a value that nobody
    would believe.
    """
    best = strained(gained.best, 1.0)
    nothing = {
        x: _with_rms(strained(gained.nothing, x), best.held_out_rms)
        for x in (1.0, IMPLAUSIBLE + 0.5)
    }
    supported = [
        Supported("effect", "sensor_gain", 0.85, ALONE),
        Supported("family", "sensor_scale", 0.85, ALONE),
    ]
    silent, stated = (
        decide_from(_with(Comparison(gained.result, (best, one)), "best", best), supported)
        for one in nothing.values()
    )
    assert silent.grade in ("nothing missing", "unexplained")
    assert stated.grade == "mostly" and stated.explained_share < 0.5
    assert stated.effects[0].wording == "these data do not tell how well the law holds"
    assert "takes the place of an implausible value (" in describe(
        stated
    ) and "+4.0 prior standard deviations off, the bound of the fit" in describe(stated)


@pytest.mark.parametrize(
    ("factor", "is_stated"), [(1.0, True), (1.1, False)], ids=["as well", "worse"]
)
def test_an_implausible_value_is_relieved_where_both_predict_worse_than_usual(
    gained, factor, is_stated
):
    """The baseline is what an impossible value reaches: no more is asked than to reach it
    without.
    """
    unusual = np.full_like(gained.best.held_out_rms, 1.5 * USUAL_MISFIT)
    best = _with_rms(strained(gained.best, 1.0), factor * unusual)
    nothing = _with_rms(strained(gained.nothing, IMPLAUSIBLE + 0.5), unusual)
    supported = [
        Supported("effect", "sensor_gain", 0.85, ALONE),
        Supported("family", "sensor_scale", 0.85, ALONE),
    ]
    decision = decide_from(
        _with(Comparison(gained.result, (best, nothing)), "best", best), supported
    )
    assert (decision.grade == "mostly") == is_stated
    assert bool(decision.relieved_strain) == is_stated


@pytest.mark.parametrize(("remains", "is_stated"), [(1.0, True), (IMPLAUSIBLE - 0.5, False)])
def test_a_value_that_moves_from_beyond_the_limit_to_within_it_is_not_relieved(
    gained, remains, is_stated
):
    best = strained(gained.best, remains)
    nothing = _with_rms(strained(gained.nothing, IMPLAUSIBLE + 0.5), best.held_out_rms)
    supported = [Supported("effect", "sensor_gain", 0.85, ALONE)]
    comparison = _with(Comparison(gained.result, (best, nothing)), "best", best)
    assert bool(decide_from(comparison, supported).relieved_strain) == is_stated


@pytest.mark.parametrize(
    ("law_error_without", "removed_share", "grade"),
    [
        (LAW_ERROR + 0.05, 0.5, "identified"),
        (LAW_ERROR - 0.05, 0.8, "unexplained"),
        (LAW_ERROR - 0.05, 0.95, "identified"),
    ],
    ids=["the others leave much", "as laws usually err", "with it nothing remains"],
)
def test_an_effect_that_makes_up_for_what_laws_usually_leave_is_not_stated(
    gained, law_error_without, removed_share, grade
):
    """Whatever its probability: an approximate law of the other effects does the same."""
    supported = [
        replace(
            one,
            probability=0.95,
            values={
                **one.values,
                "law_error_without": law_error_without,
                "removed_share": removed_share,
            },
        )
        for one in support_of_best(gained)
    ]
    decision = decide_from(gained, supported)
    assert decision.grade == grade
    assert (decision.family is None) == (grade == "unexplained")


def test_the_law_error_without_an_effect_is_that_of_the_others(gained):
    both = replace(
        gained.best,
        hypothesis=replace(gained.best.hypothesis, ids=("sensor_gain", "sensor_crosstalk")),
    )
    crosstalk = next(one for one in gained.ranked if one.ids == ("sensor_crosstalk",))
    comparison = _with(
        Comparison(gained.result, (both, gained.best, crosstalk, gained.nothing)), "best", both
    )
    assert comparison.law_error_without("sensor_crosstalk") == gained.law_error(gained.best)
    assert (
        comparison.law_error_without("sensor_gain")
        == gained.law_error(crosstalk)
        > gained.law_error(gained.best)
    )
    assert gained.law_error_without("sensor_gain") == 1.0


def test_the_others_do_not_count_where_they_need_an_implausible_value(gained):
    """A nuisance parameter at the end of its prior takes the place of the effect then."""
    both = strained(
        replace(
            gained.best,
            hypothesis=replace(gained.best.hypothesis, ids=("sensor_gain", "sensor_crosstalk")),
        ),
        0.0,
    )

    def law_error_without_crosstalk(strain):
        comparison = Comparison(
            gained.result, (both, strained(gained.best, strain), gained.nothing)
        )
        return _with(comparison, "best", both).law_error_without("sensor_crosstalk")

    assert (
        law_error_without_crosstalk(IMPLAUSIBLE + 0.1)
        == 1.0
        > LAW_ERROR
        > law_error_without_crosstalk(IMPLAUSIBLE - 0.1)
    )


def tried(family):
    """A probe of every member."""
    return tuple(
        SimpleNamespace(choice=SimpleNamespace(effect=SimpleNamespace(id=name)))
        for name in members_of(family)
    )


def test_only_an_explanation_that_predicts_as_usual_lets_effects_be_excluded(gained, uneven):
    assert graded(gained, 0.95).predicts_as_usual and graded(gained, 0.85).predicts_as_usual
    assert not graded(uneven, 0.95).predicts_as_usual
    assert not graded(
        uneven, 0.1
    ).predicts_as_usual  # nothing is stated, and the model without effects errs


def test_a_family_of_another_kind_of_rig_is_not_stated(gained):
    fluid = replace(gained.best, hypothesis=replace(gained.best.hypothesis, ids=("fluid_drag",)))
    comparison = _with(Comparison(gained.result, (fluid, gained.nothing)), "best", fluid)
    assert set(list_families(comparison)) == {"air_drag"}
    pendulum = _with(
        Comparison(
            replace(gained.result, probes=tried("joint_dissipation")), (fluid, gained.nothing)
        ),
        "best",
        fluid,
    )
    assert set(list_families(pendulum)) == {
        "air_drag",
        "joint_dissipation",
        "joint_loss_with_speed",
    }


def test_an_effect_that_is_probable_but_not_sure_is_mostly(gained):
    assert graded(gained, 0.85).grade == "mostly"


def test_where_no_effect_is_probable_the_family_is_stated(gained):
    family = graded(gained, 0.5, 0.85)
    assert (family.grade, family.effects, family.probability) == ("family", (), 0.85)
    assert family.family is not None and family.family.id == "sensor_scale"


@pytest.mark.parametrize(
    ("share", "grade"), [(0.6, "mostly"), (0.4, "unexplained")], ids=["most", "less"]
)
def test_what_explains_less_than_half_of_the_misfit_is_not_most_of_it(gained, share, grade):
    """As if the gain left so much of what it removes that the rest is more than all that it
    explains.
    """
    floor = gained.noise_floor
    left = np.sqrt(gained.nothing.misfit**2 - share * (gained.nothing.misfit**2 - floor**2))
    best = _with_rms(replace(gained.best), np.full(5, left))
    # without the effect, too, all values are plausible
    nothing = _with_rms(strained(gained.nothing, 1.0), gained.nothing.held_out_rms)
    one = Comparison(gained.result, (best, nothing))
    assert one.explained_share(one.best) == pytest.approx(share, abs=0.05)
    assert graded(one, 0.85).grade == grade
    if grade == "unexplained":
        assert graded(one, 0.85, 0.95).grade == "unexplained"  # nor is its family


def test_where_nothing_is_probable_the_misfit_stays_unexplained(gained):
    unexplained = graded(gained, 0.5, 0.5)
    assert unexplained.grade == "unexplained" and unexplained.explanation.ids == ()
    assert unexplained.closest is not None and unexplained.closest.ids == ("sensor_gain",)
    assert unexplained.suspects >= {"sensor_gain"}


def as_usual(gained):
    """The model without effects predicts as models usually do, and the recordings still prefer
    the effect.
    """
    result = replace(gained.result, unknown=replace(gained.result.unknown, log_evidence=-1e6))
    usual = {True: np.full(5, 0.3), False: np.full(5, 0.9)}
    ranked = tuple(
        _with_rms(strained(one, 1.0), usual[one.ids == ("sensor_gain",)]) for one in gained.ranked
    )
    return _with(Comparison(result, ranked), "best", ranked[gained.ranked.index(gained.best)])


def where_nothing_leads(comparison):
    """The same where the table of all sets gives every set with effects next to nothing."""
    ranked = tuple(replace(one, log_joint=-1e6) if one.ids else one for one in comparison.ranked)
    for one, former in zip(ranked, comparison.ranked, strict=True):
        one.__dict__.update(former.__dict__ | {"log_joint": one.log_joint})
    best = ranked[comparison.ranked.index(comparison.best)]
    return _with(Comparison(comparison.result, ranked), "best", best)


@pytest.mark.parametrize("probability", [0.05, 0.7])
def test_a_difference_that_the_table_shows_is_not_nothing(gained, probability):
    """However small the calibrated probability of the effect is."""
    decision = graded(as_usual(gained), probability)
    assert decision.grade == "unexplained"
    assert [rival.ids for rival in decision.alternatives] == [("sensor_gain",)]
    assert "within the usual model error, but visible: sensor_gain (> 99.9 %)" in describe(decision)
    assert decision.suspects >= {
        "sensor_gain",
        "sensor_crosstalk",
    }  # nor can what is hardly told from it be excluded


def test_nothing_is_missing_with_the_probability_of_the_table(gained):
    decision = graded(where_nothing_leads(as_usual(gained)), 0.05)
    assert decision.grade == "nothing missing"
    assert decision.probability == next(
        rival.probability for rival in decision.rivals if not rival.ids
    )
    assert decision.alternatives == ()


def test_an_explanation_with_an_implausible_value_is_not_identified(gained):
    ranked = tuple(strained(one, IMPLAUSIBLE + 0.5) if one.ids else one for one in gained.ranked)
    one = Comparison(gained.result, ranked)
    assert (
        graded(_with(one, "best", _with_rms(one.best, gained.best.held_out_rms)), 0.95).grade
        == "mostly"
    )


@pytest.mark.parametrize(
    ("rms", "strain", "log_evidence_of_unknown", "grade"),
    [
        (0.5, 1.0, -1e6, "nothing missing"),
        (2.0, 1.0, -1e6, "unexplained"),  # held-out conditions are predicted badly
        ((0.5, 0.5, 0.5, 0.5, 4.0), 1.0, -1e6, "unexplained"),  # one of them is
        (0.5, IMPLAUSIBLE + 0.5, -1e6, "unexplained"),
        (0.5, 1.0, 1e6, "unexplained"),  # a large model error is more probable
    ],
)
def test_when_a_model_without_effects_lacks_nothing(
    gained, rms, strain, log_evidence_of_unknown, grade
):
    result = replace(
        gained.result, unknown=replace(gained.result.unknown, log_evidence=log_evidence_of_unknown)
    )
    ranked = tuple(_with_rms(strained(one, strain), np.zeros(5) + rms) for one in gained.ranked)
    assert graded(where_nothing_leads(Comparison(result, ranked)), 0.5).grade == grade


@pytest.mark.parametrize(("probability", "grade"), [(0.85, "unexplained"), (0.95, "identified")])
def test_where_the_model_predicts_as_usual_without_effects_an_effect_must_be_sure(
    gained, probability, grade
):
    """The error of a model that lacks nothing may look like an effect."""
    assert graded(as_usual(gained), probability).grade == grade


def test_a_law_of_which_the_effect_is_a_special_case_is_no_rival(gained):
    """As if crosstalk were a gain of each channel: it predicts the same, and that does not speak
    against the gain.
    """

    def as_variant(one, of):
        coordinates = one.hypothesis.fitted.coordinates
        terms = [
            replace(term, effect=replace(term.effect, variant_of=of))
            for term in coordinates.choices
        ]
        fitted = replace(one.hypothesis.fitted, coordinates=coordinates.with_terms(terms))
        return replace(one, hypothesis=replace(one.hypothesis, fitted=fitted))

    crosstalk = next(one for one in gained.ranked if one.ids == ("sensor_crosstalk",))
    behind = replace(
        as_variant(crosstalk, ""), log_joint=gained.best.log_joint - AS_GOOD_LOG_ODDS - 1.0
    )
    others = [
        one for one in gained.ranked if one.ids not in (("sensor_gain",), ("sensor_crosstalk",))
    ]
    ranked = (as_variant(gained.best, "sensor_crosstalk"), behind, *others)
    comparison = Comparison(gained.result, ranked)
    assert gained.variants_of("sensor_gain") == ()
    assert comparison.variants_of("sensor_gain") == ("sensor_crosstalk",)
    assert (
        comparison.variants_of("sensor_crosstalk") == ()
    )  # the gain is part of the best explanation: both would support each other
    values = next(one.values for one in support_of_best(comparison) if one.kind == "effect")
    rival = comparison.support(("sensor_gain", "sensor_crosstalk"))
    assert rival.rival == ()
    assert values["log_bayes_factor"] == pytest.approx(np.log1p(rival.log_bayes_factor))


def test_effects_that_explain_the_data_as_well_form_a_class(gained):
    crosstalk = next(one for one in gained.ranked if one.ids == ("sensor_crosstalk",))
    near, far = (
        replace(
            gained,
            ranked=tuple(
                replace(one, log_joint=gained.best.log_joint - gap) if one is crosstalk else one
                for one in gained.ranked
            ),
        )
        for gap in (AS_GOOD_LOG_ODDS - 1.0, AS_GOOD_LOG_ODDS + 1.0)
    )
    assert (
        near.as_good_as("sensor_gain") == ("sensor_crosstalk",)
        and far.as_good_as("sensor_gain") == ()
    )
    assert near.support(("sensor_gain", "sensor_crosstalk")).rival == ()
    (effect,) = graded(near, 0.95).effects
    assert effect.cannot_tell_from == ("sensor_crosstalk",)


@pytest.mark.parametrize(
    ("alike", "told_apart", "probability", "family"),
    [
        (("spring_hysteresis", "spring_relaxation"), (), 0.95, "spring_memory"),
        (("spring_hysteresis", "hinge_viscous_damping"), (), 0.95, "hinge_dissipation"),
        (("spring_hysteresis",), (), 0.95, None),
        (("spring_hysteresis", "spring_relaxation"), ("clock_offset",), 0.95, "spring_memory"),
        (("spring_hysteresis", "hinge_viscous_damping"), ("spring_relaxation",), 0.95, None),
        (("spring_hysteresis", "clock_offset"), (), 0.95, None),
        (("spring_hysteresis", "spring_relaxation"), (), 0.85, None),
    ],
    ids=[
        "the smallest family that has all",
        "only a larger one has all",
        "two laws are named",
        "another kind of law is told apart",
        "a member is told apart",
        "no family has all",
        "the family is not sure",
    ],
)
def test_an_effect_that_is_told_from_no_law_of_its_family_is_called_by_the_familys_name(
    alike, told_apart, probability, family
):
    comparison = SimpleNamespace(
        best=SimpleNamespace(ids=("hinge_coulomb_friction",)),
        result=SimpleNamespace(probes=tried("hinge_dissipation")),
        laws_of=set,
        tells_from=lambda _: frozenset(told_apart),
    )
    supported = [
        Supported("family", name, probability, ALONE)
        for name in ("hinge_dissipation", "spring_memory")
    ]
    effect = SimpleNamespace(id="hinge_coulomb_friction", cannot_tell_from=alike)
    found = _find_family_alike(comparison, supported, effect)
    assert (found and found.id) == family


def test_a_family_stands_in_place_of_an_effect_and_beside_others(gained, monkeypatch):
    family = StatedFamily("sensor_scale", "the scale", "sensor", 0.93, ("sensor_gain",))
    monkeypatch.setattr(families, "_find_family_alike", lambda *_: family)
    alone = graded(gained, 0.95, 0.95)
    assert (alone.grade, alone.effects, alone.family) == ("family", (), family)
    assert alone.probability == 0.93
    assert "no other law of its family" in alone.not_stated["sensor_gain"]
    effect = graded_without_families(gained, monkeypatch).effects[0]
    lag = replace(effect, id="sensor_lag")
    both = replace(alone, grade="identified", effects=(effect, lag), family=None, probability=0.95)
    monkeypatch.setattr(
        families, "_find_family_alike", lambda *words: family if words[-1] is effect else None
    )
    beside = name_families(gained, (), both)
    assert (beside.grade, beside.effects, beside.probability) == ("identified", (lag,), 0.95)
    assert beside.other_families[0] is family
    # A family to which another stated effect belongs would say what that effect says.
    member = replace(effect, id="sensor_crosstalk")
    wide = replace(family, members=("sensor_gain", "sensor_crosstalk"))
    monkeypatch.setattr(
        families, "_find_family_alike", lambda *words: wide if words[-1] is effect else None
    )
    in_it = replace(both, effects=(effect, member))
    assert name_families(gained, (), in_it) is in_it


def graded_without_families(gained, monkeypatch):
    """The decision with its effects, whatever looks alike."""
    monkeypatch.setattr(families, "_find_family_alike", lambda *_: None)
    return graded(gained, 0.95, 0.95)


def test_effects_in_place_of_another_are_as_good_or_told_apart(gained):
    crosstalk = next(one for one in gained.ranked if one.ids == ("sensor_crosstalk",))
    others = [one for one in gained.ranked if one is not crosstalk]
    near = replace(crosstalk, log_joint=gained.best.log_joint - AS_GOOD_LOG_ODDS + 1.0)
    far = replace(
        crosstalk,
        log_joint=gained.best.log_joint - AS_GOOD_LOG_ODDS - 1.0,
        log_evidence=gained.best.log_evidence - AS_GOOD_LOG_ODDS - 1.0,
    )
    told_near = Comparison(gained.result, (*others, near)).tells_from("sensor_gain")
    told_far = Comparison(gained.result, (*others, far)).tells_from("sensor_gain")
    assert "sensor_crosstalk" not in told_near
    assert "sensor_crosstalk" in told_far


def test_effects_that_only_a_model_better_than_usual_tells_apart_form_a_class(gained):
    """Crosstalk as good as the gain at the usual model error, and far behind at smaller ones."""
    crosstalk = next(one for one in gained.ranked if one.ids == ("sensor_crosstalk",))
    scales = np.array([whitening.s for whitening in gained.result.likelihood.every_scale])
    behind = np.where(scales < 0.01, 50.0, 1.0)
    alike = replace(
        crosstalk,
        log_joint=gained.best.log_joint - 50.0,
        log_evidence=gained.best.log_evidence - behind,
    )
    others = [one for one in gained.ranked if one not in (crosstalk, gained.best)]
    assert Comparison(gained.result, (gained.best, alike, *others)).as_good_as("sensor_gain") == (
        "sensor_crosstalk",
    )
    apart = replace(alike, log_evidence=gained.best.log_evidence - 50.0)
    assert Comparison(gained.result, (gained.best, apart, *others)).as_good_as("sensor_gain") == ()


def _with(comparison, name, value):
    comparison.__dict__[name] = value
    return comparison


@pytest.mark.parametrize(
    ("ids", "share", "unsure"),
    [
        (("added_mass", "gravity_tilt"), 0.2, {"added_mass", "gravity_tilt"}),
        (("added_mass", "gravity_tilt"), 0.6, set()),
        (("added_mass", "joint_friction"), 0.2, set()),
    ],
    ids=["they only replace values", "they explain", "of two families"],
)
def test_laws_of_a_family_that_only_replace_implausible_values_are_not_told_apart(
    ids, share, unsure
):
    best = SimpleNamespace(ids=ids)
    shares = {id(best): share}
    comparison = SimpleNamespace(
        best=best, ranked=(), explained_share=lambda one: shares[id(one)], laws_of=set
    )
    assert Comparison.find_unsure_laws(comparison) == unsure


@pytest.mark.parametrize(
    ("of_memory", "expected"), [(0.85, "hinge_dissipation"), (0.9, "spring_memory")]
)
def test_of_two_families_that_are_as_probable_the_larger_is_stated(of_memory, expected):
    """Every effect that gives the spring a memory dissipates, too."""
    comparison = SimpleNamespace(
        best=SimpleNamespace(ids=("spring_relaxation",)),
        result=SimpleNamespace(probes=tried("hinge_dissipation")),
    )
    supported = [
        Supported("family", name, p, ALONE)
        for name, p in (("hinge_dissipation", 0.85), ("spring_memory", of_memory))
    ]
    assert find_best_family(comparison, supported, comparison.best.ids).id == expected


@pytest.mark.parametrize(
    ("of_mass", "of_losses", "expected"),
    [(0.95, 0.91, ["joint_dissipation"]), (0.95, 0.89, []), (0.7, 0.9, [])],
)
def test_the_families_of_all_parts_of_an_explanation_are_stated_where_they_are_sure(
    of_mass, of_losses, expected
):
    """A weight beside a gear's loss: neither belongs to a family of the other."""
    best = SimpleNamespace(ids=("added_mass", "joint_load_friction"))
    comparison = SimpleNamespace(
        best=best, result=SimpleNamespace(probes=[*tried("body_mass"), *tried("joint_dissipation")])
    )
    supported = [
        Supported("family", name, p, ALONE)
        for name, p in (("body_mass", of_mass), ("joint_dissipation", of_losses))
    ]
    first = find_best_family(comparison, supported, best.ids)
    others = find_other_families(comparison, supported, first.members)
    assert [family.id for family in others] == expected


@pytest.mark.parametrize("holds", [True, False])
def test_a_law_that_the_effect_becomes_in_a_limit_is_reported_with_it_where_the_limit_holds(
    gained, holds
):
    def with_limit(one):
        coordinates = one.hypothesis.fitted.coordinates
        limit = EqualLimit(
            "sensor_crosstalk", "-", lambda values: (values["factor"] > 1.1) == holds
        )
        terms = [
            replace(term, effect=replace(term.effect, equal_limits=(limit,)))
            for term in coordinates.choices
        ]
        fitted = replace(one.hypothesis.fitted, coordinates=coordinates.with_terms(terms))
        return replace(one, hypothesis=replace(one.hypothesis, fitted=fitted))

    ranked = tuple(with_limit(one) if one.ids == ("sensor_gain",) else one for one in gained.ranked)
    comparison = Comparison(gained.result, ranked)
    decision = decide_from(comparison, support_of_best(comparison))
    assert [effect.cannot_tell_from for effect in decision.effects] == [
        ("sensor_crosstalk",) if holds else ()
    ]
    rival = comparison.support(("sensor_gain", "sensor_crosstalk") if holds else ("sensor_gain",))
    values = next(one.values for one in support_of_best(comparison) if one.kind == "effect")
    assert values["log_bayes_factor"] == pytest.approx(np.log1p(rival.log_bayes_factor))


def test_a_rival_that_needs_an_implausible_value_explains_nothing(gained):
    """The effect took the place of that value; the next set that needs none is the rival."""
    crosstalk = next(one for one in gained.ranked if one.ids == ("sensor_crosstalk",))
    nothing = strained(gained.nothing, IMPLAUSIBLE + 1.0)
    others = [
        replace(strained(crosstalk, 1.0), log_joint=nothing.log_joint - 5.0),
        strained(gained.best, 1.0),
    ]
    comparison = Comparison(
        gained.result, tuple(sorted((nothing, *others), key=lambda one: -one.log_joint))
    )
    assert comparison.without(("sensor_gain",)).ids == ("sensor_crosstalk",)
    # where every rival needs such a value, the most probable one counts
    alone = Comparison(
        gained.result, tuple(one for one in comparison.ranked if one.ids != ("sensor_crosstalk",))
    )
    assert alone.without(("sensor_gain",)).ids == ()


def test_a_few_conditions_that_are_predicted_far_worse_count_in_the_explained_share(gained):
    plain = replace(gained.nothing)
    best = replace(gained.best)
    comparison = _with(
        Comparison(gained.result, (best, plain)), "nothing", _with_rms(plain, np.full(5, 4.0))
    )
    assert comparison.explained_share(_with_rms(replace(best), np.full(5, 1.0))) > 0.9
    assert (
        comparison.explained_share(_with_rms(replace(best), np.array([1.0, 1.0, 1.0, 1.0, 30.0])))
        < 0.0
    )


def leaving(comparison, without, with_effects):
    """The comparison had held-out conditions left these residuals (m,), without and with
    effects.
    """
    nothing = replace(comparison.nothing)
    nothing.__dict__["squared_residuals"] = without**2
    best = replace(comparison.best)
    best.__dict__["squared_residuals"] = with_effects**2
    return Comparison(comparison.result, (best, nothing))


def predicts_worse(comparison):
    return comparison.predicts_worse(comparison.ranked[0])


def predicts_a_quantity_worse(comparison):
    return comparison.predicts_a_quantity_worse(comparison.ranked[0])


def test_a_quantity_is_all_signals_of_one_unit(gained):
    """Of two forces the smaller one is predicted worse, and both together better; a torque alone
    is predicted worse.
    """
    rows = gained.result.dataset.rows
    assert {str(signal) for signal in np.unique(rows.signal)} >= {"fy_N", "fz_N", "tx_Nm"}

    def worsens(**with_effects):
        without = dict.fromkeys(with_effects, 5.0)
        sizes = (
            np.array([size.get(str(s), 1.0) for s in rows.signal])
            for size in (without, with_effects)
        )
        return predicts_a_quantity_worse(leaving(gained, *sizes))

    assert not worsens(fy_N=6.0, fz_N=2.0, tx_Nm=1.0)
    assert worsens(fy_N=1.0, fz_N=1.0, tx_Nm=6.0)


def test_a_quantity_is_judged_in_its_unit_not_in_the_smallest_of_its_usual_errors(gained):
    """One row with a tiny usual error is predicted worse, while nearly all others are predicted
    far better.
    """
    usual_std = np.sqrt(gained.result.likelihood.usual.variance())
    before = 20.0 * usual_std
    after = 2.0 * usual_std
    smallest = int(np.argmin(usual_std))
    after[smallest] = 20.0 * np.sqrt(usual_std.size) * 1.1 * usual_std[smallest]
    assert np.mean((after / usual_std) ** 2) > np.mean((before / usual_std) ** 2)
    assert not predicts_a_quantity_worse(leaving(gained, before, after))


def test_a_quantity_may_be_predicted_worse_within_the_usual_error(gained):
    usual_std = np.sqrt(gained.result.likelihood.usual.variance())
    assert not predicts_a_quantity_worse(leaving(gained, 0.5 * usual_std, 1.1 * usual_std))
    assert predicts_a_quantity_worse(leaving(gained, 0.5 * usual_std, 1.3 * usual_std))


def test_a_held_out_error_may_not_rise_in_sum_even_within_the_usual(gained):
    usual_std = np.sqrt(gained.result.likelihood.usual.variance())
    assert predicts_worse(leaving(gained, 0.5 * usual_std, 0.6 * usual_std))
    assert not predicts_worse(leaving(gained, 0.5 * usual_std, 0.51 * usual_std))


@pytest.mark.parametrize(
    ("in_sum", "in_a_quantity", "grade"),
    [(False, False, "identified"), (False, True, "family"), (True, False, "unexplained")],
    ids=["nowhere", "in a quantity", "in sum"],
)
def test_a_law_that_predicts_a_quantity_worse_is_not_stated_but_its_family(
    gained, monkeypatch, in_sum, in_a_quantity, grade
):
    monkeypatch.setattr(Comparison, "predicts_worse", lambda *_: in_sum)
    monkeypatch.setattr(Comparison, "predicts_a_quantity_worse", lambda *_: in_a_quantity)
    assert graded(gained, 0.95, 0.95).grade == grade


def test_a_value_is_not_relieved_by_what_predicts_a_quantity_worse(gained, monkeypatch):
    best = strained(gained.best, 1.0)
    nothing = _with_rms(strained(gained.nothing, IMPLAUSIBLE + 0.5), best.held_out_rms)
    supported = [Supported("family", "sensor_scale", 0.95, ALONE)]
    grades = []
    for is_worse in (False, True):
        monkeypatch.setattr(
            Comparison, "predicts_a_quantity_worse", lambda *_, is_worse=is_worse: is_worse
        )
        comparison = _with(Comparison(gained.result, (best, nothing)), "best", best)
        grades.append(
            decide_from(
                comparison, [*supported, Supported("effect", "sensor_gain", 0.5, ALONE)]
            ).grade
        )
    assert grades == ["family", "unexplained"]


def test_evidence_counts_only_where_held_out_conditions_confirm_it(gained):
    nothing = _with_rms(replace(strained(gained.nothing, 1.0)), np.full(5, 1.0))

    def evidence(rms):
        best = _with_rms(strained(gained.best, 1.0), np.full(5, rms))
        reduced = _without_unconfirmed(best, (nothing, best))
        return (
            reduced.log_joint
            - reduced.hypothesis.log_prior
            - (nothing.log_joint - nothing.hypothesis.log_prior)
        )

    assert evidence(0.97) == pytest.approx(0.0, abs=1e-9)
    assert evidence(0.5) > 100.0


@pytest.mark.parametrize(
    ("own", "others", "is_less"),
    [(4.0, 1.0, True), (3.0, 1.0, False), (4.0, 3.7, False), (6.0, 3.7, True), (3.7, 6.0, False)],
)
def test_of_two_that_need_implausible_values_the_one_with_more_of_them_is_less_plausible(
    gained, own, others, is_less
):
    assert (
        strained(gained.nothing, own).is_less_plausible_than(strained(gained.best, others))
        == is_less
    )


def test_evidence_of_a_set_does_not_exceed_that_of_a_simpler_one_that_predicts_better(gained):
    """The simpler set is no part of it: it has another effect."""
    (rival,) = (one for one in gained.ranked if one.ids == ("sensor_crosstalk",))
    hypothesis = replace(gained.best.hypothesis, ids=("sensor_gain", "clock_offset"))

    def evidence(rms):
        pair = replace(gained.best, hypothesis=hypothesis)
        pair.__dict__.update(nuisance_shifts=np.zeros(1), held_out_rms=np.array(rms))
        simpler = _with_rms(strained(rival, 1.0), np.full(5, 1.0))
        reduced = _without_unconfirmed(pair, (pair, simpler))
        return (
            reduced.log_joint
            - reduced.hypothesis.log_prior
            - (simpler.log_joint - simpler.hypothesis.log_prior)
        )

    assert evidence([1.1, 1.1, 1.1, 1.1, 3.0]) == pytest.approx(0.0, abs=1e-9)
    # better in the median over conditions, or in the rms over them: nothing contradicts the
    # evidence
    assert evidence([0.9, 0.9, 0.9, 0.9, 3.0]) > 100.0
    assert evidence([0.1, 0.1, 1.1, 1.1, 1.1]) > 100.0


def test_a_partner_that_is_as_good_as_another_widens_a_size():
    """Friction of 17 with one law of drag beside it, and of 11 with another."""
    sizes = [({"torque_Nm": Value(17.0, 3.0)}, {}), ({"torque_Nm": Value(11.0, 3.0)}, {})]
    (value,) = widen(sizes, 0).values()
    assert value.value == 17.0
    assert value.std == pytest.approx(np.hypot(3.0, 6.0 / np.sqrt(2.0)))
    assert widen(sizes[:1], 0) == sizes[0][0]


@pytest.mark.parametrize(
    ("names", "several"),
    [
        (("joint1_torque_Nm", "joint2_torque_Nm"), True),
        (("motor1_factor", "motor2_factor"), True),
        (("left_knee_torque_Nm", "hip_torque_Nm", "rise_relative"), True),
        (("kp_Nm_s_per_rad", "ki_Nm_per_rad"), False),
        (("angle_deg", "stiffness_Nm_per_rad"), False),
        (("torque_Nm",), False),
    ],
)
def test_an_effect_may_have_a_size_for_each_of_several_joints(names, several):
    parameters = tuple(Parameter(name, 0.1, 1.0) for name in names)
    effect = replace(catalogue()["tip_mass"], parameters=parameters)
    assert sizes.has_several_sizes(effect) == several
