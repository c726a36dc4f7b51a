"""The marks, on diagnoses made by hand."""

import numpy as np
import pytest

from rfca_rig.errors import BadInput
from rfca_rig.exam import cases
from rfca_rig.exam.answer import (
    CAUTIOUS,
    CLASS,
    EXTRA,
    PARTIAL,
    RIGHT,
    SILENT,
    WRONG,
    Claim,
    ParsedDiagnosis,
    outcome,
    parse_diagnosis,
    parse_truth,
    read_diagnosis,
)
from rfca_rig.exam.claims import calibration, values
from rfca_rig.exam.score import Share, score


def truth(case="case-0001", kind=cases.SINGLE, effects=None, **others):
    return {
        "case": case,
        "kind": kind,
        "effects": effects or {},
        "strangers": {},
        "mislabelled": None,
        "also_right": [],
        "silence_is_right": False,
        "strength": 0.5,
        "size": {"shift_over_noise": 10.0, "left_over_noise": 5.0},
        "left_of_each": dict.fromkeys(effects or {}, 5.0),
        "structured": None,
        "uneven": None,
        "design": {"conditions": [[215.0, 2.0], [235.0, 2.0]]},
        **others,
    }


PLAY = {"hinge_backlash": {"half_gap_deg": 1.0}}
PLAY_AND_LAG = {**PLAY, "sensor_lag": {"time_constant_s": 0.01}}


def named(*claims, **others):
    return ParsedDiagnosis("named", tuple(claims), **others)


def claim(effect, p=0.95, parameters=None, like=()):
    return Claim(effect, p, parameters or {}, tuple(like))


@pytest.mark.parametrize(
    ("true", "said", "expected"),
    [
        (truth(effects=PLAY), named(claim("hinge_backlash")), RIGHT),
        (truth(effects=PLAY), named(claim("tip_mass", like=["hinge_backlash"])), CLASS),
        (truth(effects=PLAY), named(claim("tip_mass")), WRONG),
        (truth(effects=PLAY), named(claim("hinge_backlash"), claim("tip_mass")), EXTRA),
        (truth(effects=PLAY_AND_LAG), named(claim("hinge_backlash")), PARTIAL),
        (truth(effects=PLAY_AND_LAG), named(claim("hinge_backlash"), claim("sensor_lag")), RIGHT),
        (truth(effects=PLAY_AND_LAG), named(claim("hinge_backlash"), claim("tip_mass")), WRONG),
        (truth(effects=PLAY), ParsedDiagnosis("nothing missing"), SILENT),
        (truth(effects=PLAY), ParsedDiagnosis("unexplained"), CAUTIOUS),
        (truth(kind=cases.NOTHING), ParsedDiagnosis("nothing missing"), RIGHT),
        (truth(kind=cases.NOTHING), ParsedDiagnosis("unexplained"), CAUTIOUS),
        (truth(kind=cases.NOTHING), named(claim("tip_mass")), WRONG),
        (truth(kind=cases.MODEL_ERROR, structured={}), ParsedDiagnosis("unexplained"), RIGHT),
        (
            truth(kind=cases.STRANGER, strangers={"shaking_floor": {}}),
            ParsedDiagnosis("unexplained"),
            RIGHT,
        ),
        (
            truth(kind=cases.STRANGER, strangers={"shaking_floor": {}}),
            ParsedDiagnosis("nothing missing"),
            SILENT,
        ),
        (
            truth(kind=cases.STRANGER, strangers={"shaking_floor": {}}),
            named(claim("tip_mass")),
            WRONG,
        ),
        (truth(kind=cases.MISLABEL, mislabelled="sign of fy"), ParsedDiagnosis("refused"), RIGHT),
        (
            truth(kind=cases.MISLABEL, mislabelled="heights", also_right=["height_offset"]),
            named(claim("height_offset")),
            RIGHT,
        ),
        (
            truth(kind=cases.MISLABEL, mislabelled="heights", also_right=["height_offset"]),
            named(claim("tip_mass")),
            WRONG,
        ),
        (
            truth(kind=cases.MISLABEL, mislabelled="speeds", silence_is_right=True),
            ParsedDiagnosis("nothing missing"),
            RIGHT,
        ),
        (
            truth(kind=cases.WRONG_LAW, effects=PLAY, uneven={}),
            ParsedDiagnosis("unexplained"),
            RIGHT,
        ),
        (
            truth(kind=cases.POOR_DATA, design={"conditions": [[215.0, 2.0]]}),
            ParsedDiagnosis("not enough data"),
            RIGHT,
        ),
        (truth(effects=PLAY), ParsedDiagnosis("not enough data"), CAUTIOUS),
        # what is listed without the verdict "named" is no claim
        (
            truth(kind=cases.NOTHING),
            ParsedDiagnosis("nothing missing", (claim("tip_mass", 0.2),)),
            RIGHT,
        ),
    ],
)
def test_outcome(true, said, expected):
    assert outcome(parse_truth(true), said) == expected


def test_shares_and_their_bounds():
    none = Share(0, 60)
    assert none.value == 0.0 and none.lower == 0.0
    assert none.upper == pytest.approx(1.0 - 0.05 ** (1.0 / 60.0), rel=1e-6)
    assert Share(60, 60).lower == pytest.approx(0.05 ** (1.0 / 60.0), rel=1e-6)
    assert np.isnan(Share(0, 0).value)


def test_marks_of_a_small_exam():
    truths = [
        truth("a", effects=PLAY, strength=0.1, size={"left_over_noise": 0.5}),
        truth("b", effects=PLAY, strength=0.9),
        truth("c", effects=PLAY, strength=0.9),
        truth("d", cases.NOTHING),
        truth("e", cases.MODEL_ERROR, structured={}),
        truth("f", cases.PAIR, PLAY_AND_LAG),
        truth("g", cases.STRANGER, strangers={"shaking_floor": {}}),
    ]
    said = {
        "a": ParsedDiagnosis("nothing missing"),
        "b": named(
            claim("hinge_backlash", parameters={"half_gap_deg": (1.1, 0.1)}),
            held_out_fz_N=(3.0, 0.4, 0.2),
        ),
        "c": named(claim("tip_mass", 0.8)),
        "d": ParsedDiagnosis("nothing missing"),
        "e": named(claim("sensor_gain", 0.92)),
        "f": named(claim("hinge_backlash"), claim("sensor_lag", like=["clock_offset"])),
        "g": named(claim("ground_tilt", 0.7)),
    }
    marks = score(truths, said)
    assert (marks.null_false_claims.hits, marks.null_false_claims.of) == (1, 2)
    assert (marks.false_discoveries.hits, marks.false_discoveries.of) == (3, 6)
    assert marks.single_right == Share(1, 3) and marks.single_right_detectable == Share(1, 2)
    assert sum(share.of for share in marks.power) == 3
    assert marks.pairs_exact == marks.pairs_exact_detectable == Share(1, 1)
    assert marks.stranger_wrong == Share(1, 1) and marks.stranger_confident_wrong == Share(0, 1)
    assert marks.confusion[("hinge_backlash", "tip_mass")] == 1
    assert marks.confusion[("hinge_backlash", "nothing missing")] == 1
    assert marks.truth_in_class == Share(2, 3)
    assert marks.mean_class_size == pytest.approx(7.0 / 6.0)
    assert marks.missed == Share(0, 4)  # what a hides cannot be seen
    assert marks.detection_errors == Share(2, 7)  # a silent, e alarmed
    assert marks.classification_errors == 1 + 0 + 2 + 0 + 1 + 0 + 1
    assert marks.gap_closed == pytest.approx(2.6 / 2.8) and marks.gap_worse == Share(0, 1)
    assert marks.calibration.confident == 4 and marks.calibration.confident_right == 0.75
    assert [miss.case for miss in marks.worst] == ["e", "c", "g", "a"]
    assert "sensor_gain at 92%" in marks.worst[0].reason


def test_a_pair_with_an_invisible_member_is_not_asked_for():
    pair = truth(
        "a", cases.PAIR, PLAY_AND_LAG, left_of_each={"hinge_backlash": 9.0, "sensor_lag": 0.3}
    )
    marks = score([pair], {"a": named(claim("hinge_backlash"))})
    assert marks.pairs_exact == Share(0, 1) and marks.pairs_exact_detectable == Share(0, 0)
    (miss,) = marks.worst
    assert miss.reason == "missed sensor_lag, which shifts the forces by 0.3 times the noise"


def test_what_shows_most_is_missed_worst():
    large, small = ({"hinge_backlash": 9.0, "sensor_lag": left} for left in (8.0, 0.3))
    truths = [
        truth(case, cases.PAIR, PLAY_AND_LAG, left_of_each=left)
        for case, left in (("a", small), ("b", large))
    ]
    marks = score(truths, dict.fromkeys("ab", named(claim("tip_mass", like=["hinge_backlash"]))))
    assert [(miss.case, "sensor_lag, which" in miss.reason) for miss in marks.worst] == [
        ("b", True),
        ("a", True),
    ]


def test_a_case_without_diagnosis_counts():
    assert score([truth("a", effects=PLAY)], {}).outcomes[cases.SINGLE] == {CAUTIOUS: 1}


def test_calibration_of_an_honest_and_of_a_boastful_diagnosis():
    def judged(p, right, wrong):
        hit = parse_truth(truth(effects=PLAY))
        miss = parse_truth(truth(kind=cases.NOTHING))
        return [(hit, named(claim("hinge_backlash", p)))] * right + [
            (miss, named(claim("tip_mass", p)))
        ] * wrong

    honest = calibration(judged(0.75, 3, 1))
    boastful = calibration(judged(0.99, 1, 1))
    assert honest.ece == pytest.approx(0.0) and honest.brier == pytest.approx(0.1875)
    assert boastful.ece == pytest.approx(0.49) and boastful.confident_right == 0.5
    assert boastful.log_score > honest.log_score
    assert honest.bins[7] == (4, 0.75, 0.75)


def test_an_effect_that_was_not_listed_is_no_claim():
    only = calibration([(parse_truth(truth(effects=PLAY)), ParsedDiagnosis("nothing missing"))])
    assert np.isnan(only.ece) and only.confident == 0


def test_values_are_judged_by_what_the_effect_changes():
    gain = truth(effects={"sensor_gain": {"factor": 1.03}})
    found = values(
        [(parse_truth(gain), named(claim("sensor_gain", parameters={"factor": (1.02, 0.005)})))]
    )
    assert found.median_error == pytest.approx(1.0 / 3.0)
    assert found.coverage_90 == 0.0
    hinge = truth(effects={"damaged_hinge": {"hinge": 4.0, "stiffness_factor": 0.5}})
    said = named(
        claim("damaged_hinge", parameters={"hinge": (4.0, 0.0), "stiffness_factor": (0.55, 0.05)})
    )
    both = values([(parse_truth(hinge), said)])
    assert both.count == 2 and both.coverage_90 == 1.0 and both.median_error == pytest.approx(0.05)


def test_reading_the_file_of_a_diagnosis(tmp_path):
    data = {
        "format": "rfca-diagnosis/1",
        "verdict": "named",
        "located": [],
        "effects": [
            {
                "id": "tip_mass",
                "probability": 0.9,
                "parameters": {"mass_g": {"value": 20.0, "std": 2.0}},
                "cannot_tell_from": ["x"],
            }
        ],
        "fit": {"held_out_rms_fz_N": {"before": 3.3, "after": 0.35, "noise_floor": 0.2}},
    }
    said = parse_diagnosis(data)
    assert said.named[0].members == {"tip_mass", "x"}
    assert said.held_out_fz_N == (3.3, 0.35, 0.2)
    assert read_diagnosis(tmp_path / "none.json").verdict == "refused"
    for wrong in (
        {"format": "rfca-diagnosis/3"},
        {"verdict": "maybe"},
        {"effects": [{"id": "tip_mass"}]},
    ):
        with pytest.raises(BadInput):
            parse_diagnosis({**data, **wrong})
    (tmp_path / "broken.json").write_text("{")
    with pytest.raises(BadInput, match="is not JSON"):
        read_diagnosis(tmp_path / "broken.json")


def test_power_counts_by_multiples_of_what_can_be_seen():
    shows = (0.4, 2.5, 2.6, 100.0)
    truths = [
        truth(f"case-{n}", effects=PLAY, above_of_each={"hinge_backlash": above})
        for n, above in enumerate(shows)
    ]
    said = {
        "case-1": ParsedDiagnosis("unexplained"),
        "case-2": ParsedDiagnosis(
            "unexplained", grade="family", family="hinge_stiffness", probability=0.9
        ),
    }
    found = score(truths, said | {"case-3": named(claim("hinge_backlash"))}).power
    assert [(share.hits, share.of) for share in found] == [
        (0, 1),
        (0, 0),
        (1, 2),
        (0, 0),
        (0, 0),
        (0, 0),
        (1, 1),
    ]
