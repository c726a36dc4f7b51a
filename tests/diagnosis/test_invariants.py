"""What an answer may not say beside its own numbers: a good and a bad answer of every kind."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from rfca_rig.diagnosis.diagnose import Answer, diagnose
from rfca_rig.diagnosis.leg.problem import search_base
from rfca_rig.diagnosis.mechanisms.problem import MechanismProblem
from rfca_rig.diagnosis.result import (
    BeforeAfter,
    Criterion,
    Diagnosis,
    MovedPrior,
    NamedEffect,
    NotSeen,
    Rival,
    StatedFamily,
    Value,
    describe_probability,
)
from rfca_rig.mechanism.effects import list_effects
from rfca_rig.mechanism.load import load_mechanism
from rfca_rig.mechanism.usual_motion import UsualMotion
from rfca_rig.model.catalogue import catalogue
from rfca_rig.model.parameters import PresentEffect
from tests.diagnosis.invariants import SAME_AS_IN_MECHANISMS, list_contradictions
from tests.every_answer import WatchedLimit, take_contradictions
from tests.mechanism import hopper
from tests.model.legs import PAPER

PLAY = NamedEffect(
    id="hinge_backlash",
    left_out="play before the spring engages",
    probability=0.96,
    parameters={"half_gap_deg": Value(1.1, 0.1)},
    cannot_tell_from=("spring_hysteresis",),
    wording="",
)
FAMILY = StatedFamily(
    id="joint_dissipation",
    words="the joints lose energy",
    place="joints",
    probability=0.9,
    members=("joint_friction", "joint_stribeck", "hinge_viscous_damping"),
)
MOVED_HEIGHT = MovedPrior("height", "mm", Value(0.0, 0.2), Value(0.5, 0.1), 2.5)


def rivals(**probabilities):
    """A table of sets; a double underscore joins effects, `nothing` is the empty set."""
    rows = []
    for name, probability in probabilities.items():
        ids = () if name == "nothing" else tuple(name.split("__"))
        rows.append(Rival(ids, probability, 0.0, 0.01))
    return tuple(rows)


IDENTIFIED = Diagnosis(
    title="leg",
    verdict="named",
    sentence="The model lacks: play before the spring engages (hinge_backlash).",
    located=(),
    cells=(),
    effects=(PLAY,),
    criteria=(Criterion("probability", True, "0.960 that every effect is there"),),
    rivals=rivals(
        hinge_backlash=0.9,
        hinge_backlash__tip_mass=0.005,
        unknown=0.05,
        nothing=0.001,
    ),
    not_seen=(NotSeen("sensor_drift", {"rate_N_per_s": 0.2}), NotSeen("gravity_tilt", None)),
    fit={},
    held_out={
        "held_out_rms_fy_N": BeforeAfter(1.1, 0.13, 0.07),
        "held_out_rms_fz_N": BeforeAfter(3.3, 0.35, 0.2),
    },
    valley={},
    unexplained=(),
    remarks=(),
    next_experiment=None,
    believed_values={"height": Value(0.5, 0.1)},
    overlays=(),
    settings={},
    found_effects=(PresentEffect("hinge_backlash", (("half_gap_deg", 1.1),)),),
    found_rig=PAPER,
    grade="identified",
    probability=0.96,
    explained_share=0.9,
    moved_priors=(MOVED_HEIGHT,),
    priors={"height": Value(0.0, 0.2)},
)
MOSTLY = replace(
    IDENTIFIED,
    grade="mostly",
    verdict="unexplained",
    criteria=(Criterion("held-out misfit", False, "1.42 of the usual"),),
    sentence="Mostly missing: play (hinge_backlash). It explains 90 % of the misfit, and more.",
)
OF_FAMILY = replace(
    IDENTIFIED,
    grade="family",
    verdict="unexplained",
    effects=(),
    found_effects=(),
    family=FAMILY,
    probability=0.9,
    rivals=rivals(joint_friction=0.6, joint_stribeck=0.35, nothing=0.01),
    sentence="Of the cause only the family is clear: the joints lose energy.",
)
NOTHING = replace(
    IDENTIFIED,
    grade="nothing missing",
    verdict="nothing missing",
    effects=(),
    found_effects=(),
    probability=0.97,
    explained_share=None,
    rivals=rivals(nothing=0.97, tip_mass=0.02, unknown=0.01),
    sentence="Nothing is missing that these recordings would show.",
)
UNEXPLAINED = replace(
    NOTHING,
    grade="unexplained",
    verdict="unexplained",
    probability=0.6,
    rivals=rivals(nothing=0.4, tip_mass=0.35, tip_mass__sensor_lag=0.2, unknown=0.05),
    sentence="Visible: one of tip_mass (35 %), tip_mass with sensor_lag (20 %); together 55 %.",
)
NOT_ENOUGH = replace(
    NOTHING,
    grade="not enough data",
    verdict="not enough data",
    probability=None,
    rivals=(),
    sentence="Not enough data for a verdict: 2 usable conditions, 3 are needed.",
)
GOOD = {
    "identified": IDENTIFIED,
    "mostly": MOSTLY,
    "family": OF_FAMILY,
    "nothing missing": NOTHING,
    "unexplained": UNEXPLAINED,
    "not enough data": NOT_ENOUGH,
}


def excluded(*ids):
    """Exclusions of these effects, with a size."""
    return tuple(NotSeen(effect_id, {"size": 0.1}) for effect_id in ids)


@pytest.mark.parametrize("diagnosis", GOOD.values(), ids=GOOD)
def test_nothing_contradicts_a_good_answer(diagnosis):
    assert list_contradictions(diagnosis) == []


BAD = {
    "nothing is missing with 2 % in the table": (
        replace(NOTHING, rivals=rivals(nothing=0.02, tip_mass=0.97), probability=0.02),
        "Nothing is said to be missing, but the table gives nothing 0.02.",
    ),
    "nothing is missing with exactly half": (
        replace(NOTHING, rivals=rivals(nothing=0.5, tip_mass=0.5), probability=0.5),
        "Nothing is said to be missing, but the table gives nothing 0.5.",
    ),
    "nothing is missing without a row": (
        replace(NOTHING, rivals=rivals(tip_mass=0.4), probability=0.0),
        "Nothing is said to be missing, but the table gives nothing 0.",
    ),
    "an effect is stated though nothing is probable": (
        replace(IDENTIFIED, rivals=rivals(nothing=0.7, hinge_backlash=0.3)),
        "hinge_backlash is stated, but the table gives nothing 0.7000.",
    ),
    "a family is stated though nothing is probable": (
        replace(OF_FAMILY, rivals=rivals(nothing=0.7, joint_friction=0.3)),
        "the family joint_dissipation is stated, but the table gives nothing 0.7000.",
    ),
    "something is missing though nothing is probable": (
        replace(NOTHING, grade="unexplained", verdict="unexplained", probability=0.03),
        "Something is said to be missing, but the table gives nothing 0.9700.",
    ),
    "a partner in the first row is passed over without a reason": (
        replace(IDENTIFIED, rivals=rivals(hinge_backlash__tip_mass=0.95, unknown=0.05)),
        "tip_mass is in hinge_backlash with tip_mass and is not stated, without a reason.",
    ),
    "a further family is stated where nothing is": (
        replace(UNEXPLAINED, other_families=(FAMILY,)),
        "The grade is 'unexplained', but the family joint_dissipation is stated.",
    ),
    "a further family is not sure": (
        replace(OF_FAMILY, other_families=(replace(FAMILY, probability=0.7),)),
        "The family joint_dissipation is stated with a probability of 0.7000.",
    ),
    "a further family is that of a stated effect": (
        replace(
            IDENTIFIED, other_families=(replace(FAMILY, members=("hinge_backlash", "hinge_stop")),)
        ),
        "is stated beside hinge_backlash, which belongs to it.",
    ),
    "a stated effect is excluded": (
        replace(
            IDENTIFIED,
            not_seen=excluded("hinge_backlash"),
            rivals=rivals(hinge_backlash__tip_mass=0.009, unknown=0.9),
        ),
        "hinge_backlash is excluded from size 0.1, but it is stated.",
    ),
    "an alternative is excluded": (
        replace(IDENTIFIED, not_seen=excluded("spring_hysteresis")),
        "spring_hysteresis is excluded from size 0.1, but a stated effect cannot be told",
    ),
    "a member of the family is excluded": (
        replace(OF_FAMILY, not_seen=excluded("hinge_viscous_damping")),
        "it is a member of the stated family joint_dissipation",
    ),
    "an effect with 2 % in the table is excluded": (
        replace(NOTHING, not_seen=excluded("tip_mass")),
        "tip_mass is excluded from size 0.1, but the table gives tip_mass 0.0200.",
    ),
    "an effect is excluded whose nominal value moved": (
        replace(NOTHING, not_seen=excluded("height_offset")),
        "height, which acts exactly like it, moved by +2.5 prior standard deviations",
    ),
    "an effect is excluded where it does nothing": (
        replace(NOTHING, not_seen=(NotSeen("torque_scale", {"motor1_factor": 1.0}),)),
        "torque_scale is excluded from motor1_factor 1, where it does nothing.",
    ),
    "an effect is excluded twice": (
        replace(NOTHING, not_seen=excluded("sensor_lag", "sensor_lag")),
        "The list of exclusions has sensor_lag 2 times.",
    ),
    "the stated set is in no row": (
        replace(IDENTIFIED, rivals=rivals(tip_mass=0.4, unknown=0.5)),
        "The stated set hinge_backlash is in no row of the table, nor part of a row.",
    ),
    "another set is certain": (
        replace(IDENTIFIED, rivals=rivals(tip_mass=0.9, hinge_backlash=0.1)),
        "but the table gives tip_mass, which has nothing of it, 0.9000.",
    ),
    "held-out conditions are predicted worse": (
        replace(MOSTLY, held_out={"held_out_rms_fz_N": BeforeAfter(1.0, 1.2, 0.5)}),
        "the held-out rms of all signals rises from 2 to 2.4 noise floors",
    ),
    "the probability of nothing is another one": (
        replace(NOTHING, probability=0.999),
        "Nothing is missing with 0.999000, but the table gives nothing 0.970000.",
    ),
    "the probability of something is another one": (
        replace(UNEXPLAINED, probability=0.999),
        "Something is missing with 0.999000, but the table gives nothing 0.400000.",
    ),
    "the answer is surer than its effect": (
        replace(IDENTIFIED, probability=0.99),
        "The answer has a probability of 0.9900, but hinge_backlash has 0.9600.",
    ),
    "the sentence quotes another probability of nothing": (
        replace(NOTHING, sentence="With > 99.9 % nothing is missing."),
        "The sentence quotes > 99.9 % for nothing, but the table gives 97 %.",
    ),
    "the sentence quotes another probability of a set": (
        replace(UNEXPLAINED, sentence="Visible: tip_mass with sensor_lag (30 %)."),
        "The sentence quotes 30 % for tip_mass with sensor_lag, but the table gives 20 %.",
    ),
    "the sentence quotes another share": (
        replace(MOSTLY, explained_share=0.6),
        "The sentence says that 90 % are explained, but the explained share is 0.6000.",
    ),
    "more than all is explained": (
        replace(IDENTIFIED, explained_share=1.2),
        "The stated effects explain a share of 1.2 of the misfit.",
    ),
    "the table sums to more than 1": (
        replace(NOTHING, rivals=rivals(nothing=0.97, tip_mass=0.5)),
        "The probabilities of the table sum to 1.4700.",
    ),
    "a set stands in two rows": (
        replace(
            NOTHING,
            rivals=rivals(nothing=0.97, tip_mass__sensor_lag=0.01, sensor_lag__tip_mass=0.01),
        ),
        "The table lists the set sensor_lag with tip_mass 2 times.",
    ),
    "the verdict is another one": (
        replace(IDENTIFIED, verdict="unexplained"),
        "The grade is 'identified', but the verdict is 'unexplained'.",
    ),
    "an identified effect failed a criterion": (
        replace(IDENTIFIED, criteria=MOSTLY.criteria),
        "The grade is 'identified', but held-out misfit failed: 1.42 of the usual.",
    ),
    "the model lacks the stated effect": (
        replace(IDENTIFIED, found_effects=()),
        "The effects hinge_backlash are stated, but the fitted model lacks them.",
    ),
    "the model has an effect where nothing is missing": (
        replace(NOTHING, found_effects=IDENTIFIED.found_effects),
        "The grade is 'nothing missing', but the fitted model has hinge_backlash.",
    ),
    "a moved value has two numbers": (
        replace(IDENTIFIED, believed_values={"height": Value(0.7, 0.1)}),
        "height is 0.5 among the moved values, but 0.7 among all nominal values.",
    ),
}


@pytest.mark.parametrize(("diagnosis", "expected"), BAD.values(), ids=BAD)
def test_a_contradiction_is_told_in_a_sentence_with_its_numbers(diagnosis, expected):
    (contradiction,) = list_contradictions(diagnosis)
    assert expected in contradiction


@pytest.mark.parametrize("held_out", [{}, {"held_out_rms_fz_N": BeforeAfter(1.0, 1.04, 0.5)}])
def test_held_out_conditions_may_be_missing_or_as_good(held_out):
    assert list_contradictions(replace(MOSTLY, held_out=held_out)) == []


def test_one_signal_may_be_predicted_worse_if_all_together_are_not():
    held_out = {
        "held_out_rms_fy_N": BeforeAfter(1.0, 1.2, 1.0),
        "held_out_rms_fz_N": BeforeAfter(5.0, 1.0, 1.0),
    }
    assert list_contradictions(replace(MOSTLY, held_out=held_out)) == []


def test_an_effect_that_no_size_would_have_shown_is_not_excluded():
    not_seen = (NotSeen("hinge_backlash", None), NotSeen("height_offset", None))
    assert list_contradictions(replace(IDENTIFIED, not_seen=not_seen)) == []


def test_sizes_of_a_stated_effect_may_come_from_a_larger_set():
    larger = rivals(hinge_backlash__tip_mass=0.9, unknown=0.1)
    reasons = {"tip_mass": "its calibrated probability is 0.40, and 0.8 is needed"}
    answer = replace(IDENTIFIED, rivals=larger, not_stated=reasons)
    assert list_contradictions(answer) == []


@given(st.floats(0.0, 1.0))
def test_the_percentage_that_a_report_prints_is_that_of_the_table(probability):
    """Whatever its digits are."""
    text = describe_probability(probability)
    answer = replace(
        NOTHING,
        sentence=f"Nothing is missing ({text}).",
        probability=probability,
        rivals=rivals(nothing=probability, unknown=1.0 - probability),
    )
    quoted = [text for text in list_contradictions(answer) if "quotes" in text]
    assert quoted == []


@given(st.floats(0.0, 1.0), st.floats(0.0, 1.0))
def test_nothing_is_missing_only_with_more_than_half_of_the_table(nothing, stated):
    answer = replace(
        NOTHING,
        probability=stated,
        rivals=rivals(nothing=nothing, unknown=1.0 - nothing),
    )
    is_consistent = nothing > 0.5 and abs(nothing - stated) <= 1e-6
    assert (list_contradictions(answer) == []) == is_consistent


@given(st.lists(st.floats(0.0, 1.0), min_size=3, max_size=3), st.sampled_from(sorted(catalogue())))
def test_an_effect_is_excluded_or_possible(weights, effect_id):
    """Whatever the table says of the other sets."""
    total = sum(weights) + 1.0
    own = weights[0] / total
    table = (
        Rival((), 1.0 / total, 0.0, 0.01),
        Rival((effect_id,), own, 0.0, 0.01),
        Rival(("unknown",), sum(weights[1:]) / total, 0.0, 0.01),
    )
    answer = replace(NOTHING, rivals=table, not_seen=excluded(effect_id), moved_priors=())
    exclusions = [text for text in list_contradictions(answer) if "is excluded" in text]
    assert bool(exclusions) == (own > 0.01)


def test_values_that_act_like_an_effect_of_a_contact_are_those_of_mechanisms(tmp_path):
    path = tmp_path / "hopper.xml"
    path.write_text(hopper.mjcf(hopper.Hopper()), encoding="utf-8")
    # magnitudes do not matter here
    usual = UsualMotion(
        torque=np.ones(2),
        speed=np.ones(2),
        travel=np.ones(2),
        inertia=np.ones(2),
        lowest=np.zeros(2),
        highest=np.ones(2),
        command=np.ones(1),
        has_speeds=False,
        sensors={},
    )
    effects = list_effects(load_mechanism(path), usual)
    same_as = {effect.id: effect.same_as for effect in effects if effect.same_as}
    assert same_as == SAME_AS_IN_MECHANISMS


@pytest.mark.parametrize("entry_point", [diagnose, search_base, MechanismProblem.fit])
def test_every_entry_point_limits_linear_algebra_to_one_thread_and_is_watched(entry_point):
    assert entry_point.is_watched


@pytest.mark.parametrize(
    "wrap",
    [
        lambda diagnosis: diagnosis,
        lambda diagnosis: Answer(diagnosis, (), {}),
    ],
    ids=["diagnosis", "answer"],
)
def test_the_watch_keeps_what_contradicts_itself(wrap):
    bad, expected = BAD["the answer is surer than its effect"]

    @WatchedLimit()
    def answer():
        return wrap(bad)

    assert answer() == wrap(bad)
    assert take_contradictions() == [f"the answer about 'leg': {expected}"]
    assert take_contradictions() == []


def test_a_good_answer_and_other_results_pass_the_watch():
    for result in (IDENTIFIED, 1.0, None):
        WatchedLimit()(lambda result=result: result)()
    assert take_contradictions() == []
