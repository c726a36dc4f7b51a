"""From campaign folder to verdict, on campaigns that the exam's own engine made: it shares no
law and no integrator with the model.
"""

import json
from dataclasses import replace

import pytest

from rfca_rig.campaign.reading import read_campaign
from rfca_rig.description.model_file import read_model_file
from rfca_rig.diagnosis.diagnose import diagnose
from rfca_rig.diagnosis.leg.model_files import write_fitted_model
from rfca_rig.diagnosis.leg.problem import LegProblem
from rfca_rig.exam.cases import NOTHING, ExamDesign, draw_cases
from rfca_rig.exam.simulate_campaign import write_campaign
from rfca_rig.reports.diagnosis.files import write_diagnosis
from tests.diagnosis.by_hand import late

SHORT = ExamDesign(
    tuple((height, speed) for height in (195.0, 215.0) for speed in (2.2, 3.0)), 2, (215.0,)
)


def campaign(folder, effects):
    (case,) = draw_cases(7, {NOTHING: 1})
    write_campaign(replace(case, design=SHORT, effects=effects), folder / "campaign")
    return read_campaign(folder / "campaign")


def silent(_text, _share):
    pass


def told(recording):
    return diagnose(LegProblem((recording,)), silent).diagnosis


@pytest.mark.slow
def test_where_nothing_was_left_out_nothing_is_claimed(tmp_path):
    diagnosis = told(campaign(tmp_path, {}))
    assert diagnosis.verdict == "nothing missing"
    assert not diagnosis.effects
    assert not write_fitted_model(
        tmp_path / "model.toml", diagnosis, campaign(tmp_path / "again", {})
    )
    seen = {effect.id: effect.would_have_seen for effect in diagnosis.not_seen}
    assert seen["hinge_backlash"]["half_gap_deg"] < 0.5


@pytest.mark.long
def test_a_drive_that_is_late_is_no_cause(tmp_path):
    recording = campaign(tmp_path, {})
    diagnosis = told(
        replace(recording, strokes=tuple(late(stroke, 2e-3) for stroke in recording.strokes))
    )
    assert diagnosis.verdict == "nothing missing"
    assert "but for being 2.0 ms late the drive follows its commands" in diagnosis.remarks
    assert diagnosis.fit["rms_fz_N"].after < diagnosis.fit["rms_fz_N"].noise_floor


@pytest.mark.long
@pytest.mark.parametrize(
    ("effect", "values"),
    [
        ("hinge_backlash", {"half_gap_deg": 0.9}),
        ("height_offset", {"offset_mm": 3.0}),
        (
            "hinge_stop",
            {"angle_deg": 22.6, "stiffness_Nm_per_rad": 12.5},
        ),  # soft, and seen within a quarter of a degree only
        ("motor_speed_droop", None),
    ],
)
def test_what_was_left_out_is_named_with_its_size(tmp_path, effect, values):
    values = values or {"kp_Nm_s_per_rad": 4.0, "ki_Nm_per_rad": 25.0}
    recording = campaign(tmp_path, {effect: values})
    diagnosis = told(recording)
    assert [found.id for found in diagnosis.effects] == [effect]
    for name, value in values.items():
        assert diagnosis.effects[0].parameters[name].value == pytest.approx(value, rel=0.1)
    assert write_fitted_model(tmp_path / "model.toml", diagnosis, recording)
    assert effect in [
        present.id for present in read_model_file(tmp_path / "model.toml").model().effects
    ]
    write_diagnosis(diagnosis, tmp_path)
    assert json.loads((tmp_path / "diagnosis.json").read_text())["effects"][0]["id"] == effect


@pytest.mark.long
def test_one_condition_is_not_enough_for_a_name(tmp_path):
    recording = campaign(tmp_path, {"hinge_backlash": {"half_gap_deg": 0.9}})
    few = replace(recording, strokes=recording.strokes[:2])
    assert told(few).verdict == "not enough data"
