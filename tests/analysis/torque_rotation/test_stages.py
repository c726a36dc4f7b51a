"""Which stages count, and what is refused."""

from dataclasses import replace
from math import nan

import numpy as np
import pytest

from rfca_rig.analysis.torque_rotation.evaluate import StageAssumptions, evaluate
from rfca_rig.analysis.torque_rotation.stages import MARKS_DEG, make_stage_data
from rfca_rig.analysis.torque_rotation.static_result import remarks
from rfca_rig.cli.commands.measure.static import USUAL
from rfca_rig.errors import BadInput, SimulationFailed
from rfca_rig.vision.hinge_angles import GLUING_STD_M
from tests.analysis.torque_rotation.tables import KNOWN_TO, NOISE, SECTIONS, noisy, plain, recording

SUPPOSED = StageAssumptions(SECTIONS, KNOWN_TO)


def test_missing_angles_are_filled_by_statics_and_have_no_points():
    stages = list(noisy(plain(), np.random.default_rng(1)))
    stages[3] = replace(stages[3], hinge_deg=(nan, *stages[3].hinge_deg[1:]))
    stages[9] = replace(
        stages[9], hinge_deg=(*stages[9].hinge_deg[:2], nan, nan, *stages[9].hinge_deg[4:])
    )
    result = evaluate([recording(stages)], SUPPOSED)
    assert result.values.k0_Nm_per_rad == pytest.approx(11.0, rel=0.005)
    assert np.argwhere(np.isnan(result.points.torque_Nm)).tolist() == [[3, 0], [9, 2], [9, 3]]
    filled = np.degrees(result.found.adjusted.point.z[[3, 9, 9], [0, 2, 3]])
    assert filled == pytest.approx([plain()[3].hinge_deg[0], *plain()[9].hinge_deg[2:4]], abs=0.3)
    whole = evaluate(
        [recording(noisy(plain(), np.random.default_rng(1)))], SUPPOSED
    ).points.torque_Nm
    assert result.points.torque_Nm[3, 1:] == pytest.approx(whole[3, 1:], abs=0.015)


def test_stages_that_did_not_settle_or_have_no_photo_are_left_out_and_named():
    stages = list(noisy(plain(), np.random.default_rng(1)))
    stages[0] = replace(stages[0], settled=False)
    stages[1] = replace(stages[1], hinge_deg=(nan,) * 6)
    result = evaluate([recording(stages)], SUPPOSED)
    assert len(result.data.stages) == 14
    assert remarks(result) == [
        "Stage 1 at 215 mm is left out: had not settled.",
        "Stage 2 at 215 mm is left out: no hinge angle.",
    ]


def test_how_hinges_came_to_their_angles():
    data = make_stage_data([recording(plain())], NOISE)
    assert (data.turned[0] <= 0).all()  # from straight
    assert data.turned[6].tolist() == [1.0, 1.0, 0.0, -1.0, -1.0, -1.0]
    assert (data.turned[8] <= 0).all()  # another height begins from straight again


def test_noise_of_a_mean_from_what_the_stage_states():
    stages = [replace(stage, std={"fz_N": 0.45}) for stage in plain()]
    data = make_stage_data([recording(stages)], {"fz_N": 0.15, "fy_N": None})
    assert data.force_std[0] == pytest.approx(np.array([0.1, 0.45, 0.006]) / np.sqrt(5.0))


def test_stages_that_allow_no_balance_are_said_to():
    with pytest.raises(
        SimulationFailed, match=r"stage \d at 2\d5 mm is farthest from one: look for a wrong sign"
    ):
        evaluate(
            [recording(tuple(replace(stage, fz_N=-stage.fz_N) for stage in plain()))], SUPPOSED
        )


def test_a_stray_angle_is_named():
    stages = list(noisy(plain(), np.random.default_rng(1)))
    stages[4] = replace(
        stages[4],
        hinge_deg=(*stages[4].hinge_deg[:4], stages[4].hinge_deg[4] + 6.0, stages[4].hinge_deg[5]),
    )
    result = evaluate([recording(stages)], SUPPOSED)
    assert (result.strays[0].label, result.strays[0].words) == ("stage 5 at 215 mm", "hinge 6")
    assert any(said.startswith("In stage 5 at 215 mm hinge 6 reads +") for said in remarks(result))


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda _: (), "'static' holds no static stages; record some with: rfca-rig static run"),
        (
            lambda stages: tuple(replace(s, hinge_deg=(nan,) * 6) for s in stages),
            "none of its 16 static stages has a hinge angle; record the stages with",
        ),
        (
            lambda stages: stages[:2],
            "2 settled stages with 12 hinge angles in all: a curve needs at least 3 stages",
        ),
        (
            lambda stages: tuple(
                replace(s, hinge_deg=tuple(np.radians(s.hinge_deg))) for s in stages
            ),
            "look whether the angles are in degrees",
        ),
        (
            lambda stages: tuple(
                replace(s, hinge_deg=s.hinge_deg[:5], hinge_std_deg=()) for s in stages
            ),
            "stage 1 at 215 mm has 5 hinges and the",
        ),
    ],
    ids=["no stages", "no angles", "too few", "radians", "another leg"],
)
def test_what_cannot_give_a_curve_is_refused_in_a_line(change, said):
    with pytest.raises(BadInput) as refusal:
        evaluate([recording(change(plain()))], SUPPOSED)
    assert said in str(refusal.value)
    assert "\n" not in str(refusal.value)


def test_marks_count_as_glued_to_a_tenth_of_a_millimetre():
    mark_to_mark_m = 39.333e-3
    turn_rad = np.sqrt(6.0) * GLUING_STD_M / mark_to_mark_m
    assert pytest.approx(np.degrees(turn_rad), abs=0.005) == MARKS_DEG
    assert USUAL["--marks-deg"] == MARKS_DEG
