"""Scores of graded answers, on answers made by hand."""

import pytest

from rfca_rig.exam import cases
from rfca_rig.exam.answer import Claim, ParsedDiagnosis, parse_truth
from rfca_rig.exam.cases import UNKNOWN_FAULT_RANGES
from rfca_rig.exam.claims import STRANGERS, score_statements, statements
from rfca_rig.exam.pendulums import cases as pendulum_cases
from rfca_rig.exam.score import score
from rfca_rig.model.families import FAMILIES
from tests.exam_cases.test_score import PLAY, PLAY_AND_LAG, truth

FRICTION = {"hinge_coulomb_friction": {"torque_Nm": 0.1}}


def stated(*claims, grade="mostly", **others):
    return ParsedDiagnosis("unexplained", tuple(claims), grade=grade, **others)


def claim(effect, p=0.9, like=(), **parameters):
    return Claim(effect, p, parameters, tuple(like))


def scored(*pairs):
    return score_statements([(parse_truth(true), said) for true, said in pairs])


def family(name, p=0.9):
    return stated(grade="family", family=name, probability=p)


@pytest.mark.parametrize(
    ("true", "said", "expected"),
    [
        (truth(effects=PLAY), stated(claim("hinge_backlash")), [(0.9, True)]),
        (
            truth(effects=PLAY),
            stated(claim("tip_mass"), claim("hinge_backlash", 0.85)),
            [(0.9, False), (0.85, True)],
        ),
        (truth(effects=PLAY), stated(claim("tip_mass", like=["hinge_backlash"])), [(0.9, True)]),
        (truth(effects=FRICTION), family("spring_memory"), [(0.9, True)]),
        (truth(effects=PLAY), family("spring_memory"), [(0.9, False)]),
        # of an effect outside the catalogue only the family can be right
        (
            truth(kind=cases.STRANGER, strangers={"tendon": {}}),
            family("hinge_stiffness"),
            [(0.9, True)],
        ),
        (
            truth(kind=cases.STRANGER, strangers={"tendon": {}}),
            stated(claim("tip_mass")),
            [(0.9, False)],
        ),
        (truth(effects=PLAY), stated(claim("tip_mass"), grade="unexplained"), []),
    ],
)
def test_which_statements_are_true(true, said, expected):
    assert list(statements(parse_truth(true), said)) == expected


def test_what_is_stated_of_nothing_and_wrongly():
    nothing = truth(kind=cases.NOTHING)
    found = scored(
        (nothing, family("leg_mass")),
        (nothing, ParsedDiagnosis("nothing missing")),
        (truth(effects=PLAY), stated(claim("tip_mass", 0.7))),
    )
    assert found.claims_on_nothing == (1, 2)
    assert found.wrong == (1, 1)  # what is stated with less than 80 % is no sure statement


def test_sizes_families_and_triples():
    approximate = {"kind": cases.APPROXIMATE, "uneven": {}}
    three = truth(kind=cases.TRIPLE, effects=PLAY_AND_LAG | FRICTION)
    found = scored(
        (truth(effects=PLAY), stated(claim("hinge_backlash", half_gap_deg=(1.2, 0.1)))),
        (truth(effects=PLAY), stated(claim("hinge_backlash", half_gap_deg=(1.1, 0.1)))),
        (truth(effects=FRICTION, **approximate), stated(claim("spring_hysteresis"))),
        (truth(effects=FRICTION, **approximate), stated(claim("tip_mass"))),
        (truth(effects=FRICTION, **approximate), family("hinge_dissipation")),
        (
            truth(effects=FRICTION, **approximate),
            stated(claim("hinge_coulomb_friction", torque_Nm=(0.09, 0.01))),
        ),
        (three, stated(claim("hinge_backlash"), claim("sensor_lag"))),
        (three, stated(claim("hinge_backlash"), claim("sensor_lag"), claim("tip_mass"))),
        (three, stated(claim("hinge_backlash"))),
    )
    assert found.sizes == (1, 2) and found.family_sizes == (1, 1)
    assert found.family == (3, 4) and found.triples == (1, 3)


def test_places_and_calibration():
    shaking, cord = (
        truth(kind=cases.STRANGER, strangers={name: {}}) for name in ("shaking_floor", "tendon")
    )
    found = scored(
        (
            shaking,
            stated(
                grade="unexplained",
                place="ground",
                support=(
                    ("effect", frozenset({"ground_tilt"}), 0.4),
                    ("family", frozenset({"floor_geometry"}), 0.6),
                ),
            ),
        ),
        (
            cord,
            stated(
                grade="unexplained",
                place="sensor",
                support=(("effect", frozenset({"tip_mass"}), 0.1),),
            ),
        ),
        (cord, stated(grade="unexplained")),
    )
    assert found.place == (1, 2)
    # 0.4 of an effect that is not there, 0.6 of a family that is: each misses by 0.4; 0.1 is below
    # what counts
    assert found.probabilities == 2 and found.calibration_error == pytest.approx(0.4)


def test_every_effect_outside_the_catalogue_has_a_place_and_a_known_family():
    assert set(STRANGERS) == {*UNKNOWN_FAULT_RANGES, *pendulum_cases.STRANGERS}
    known = {family.id for family in FAMILIES}
    for families, _ in STRANGERS.values():
        assert set(families) <= known


def test_visible_single_effects_count_where_they_or_their_family_are_stated():
    faint = truth(
        kind=cases.SINGLE,
        effects=FRICTION,
        size={"left_over_noise": 0.5},
        left_of_each={"hinge_coulomb_friction": 0.5},
    )
    seen = truth(
        kind=cases.SINGLE,
        effects=FRICTION,
        size={"left_over_noise": 5.0},
        left_of_each={"hinge_coulomb_friction": 5.0},
    )
    wrong = stated(claim("hinge_coulomb_friction"), claim("sensor_gain"))
    scores = scored(
        (faint, ParsedDiagnosis("nothing missing")),
        (seen, family("hinge_dissipation")),
        (seen, wrong),
        (seen, ParsedDiagnosis("unexplained")),
    )
    assert scores.singles == (1, 3)


def test_pendulums_are_scored_apart():
    leg = truth(case="case-0001", kind=cases.NOTHING)
    swings = truth(case="case-0002", kind=pendulum_cases.PENDULUM_NOTHING)
    marks = score(
        [leg, swings],
        {
            "case-0001": ParsedDiagnosis("nothing missing"),
            "case-0002": stated(claim("joint_friction")),
        },
    )
    assert marks.statements.claims_on_nothing == (0, 1) and marks.statements.wrong == (0, 0)
    assert marks.pendulums.claims_on_nothing == (1, 1) and marks.pendulums.wrong == (1, 1)
    assert marks.worst[0].reason == "stated joint_friction as mostly at 90%, there is nothing"
