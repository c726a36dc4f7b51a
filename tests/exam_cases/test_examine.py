"""The exam from end to end, with diagnoses that are simple enough to know their marks."""

import json
from pathlib import Path

import pytest

from rfca_rig.errors import BadInput
from rfca_rig.exam import cases
from rfca_rig.exam.examine import examine

NUMBERS = {cases.POOR_DATA: 2}


def says(verdict: str):
    def diagnose(campaign: Path, into: Path) -> None:
        assert (campaign / "campaign.toml").is_file()
        into.mkdir()
        (into / "diagnosis.json").write_text(json.dumps({"format": "rfca-diagnosis/1", "verdict": verdict, "effects": []}))

    return diagnose


def refuses(campaign: Path, into: Path) -> None:
    raise BadInput(f"{campaign}: too few strokes")


def crashes(campaign: Path, into: Path) -> None:
    raise ZeroDivisionError


def test_one_who_wants_more_data_is_right_about_poor_data(tmp_path):
    assert examine(tmp_path / "exam", 1, NUMBERS, says("not enough data")).outcomes == {cases.POOR_DATA: {"right": 2}}


def test_one_who_sees_nothing_misses_what_is_there(tmp_path):
    assert examine(tmp_path / "exam", 1, NUMBERS, says("nothing missing")).outcomes == {cases.POOR_DATA: {"right": 1, "silent": 1}}


def test_a_refusal_is_an_answer_and_a_crash_is_not(tmp_path):
    assert examine(tmp_path / "exam", 1, NUMBERS, refuses).outcomes == {cases.POOR_DATA: {"right": 2}}
    assert "too few strokes" in next((tmp_path / "exam" / "diagnoses").glob("*/refused.txt")).read_text()
    with pytest.raises(ZeroDivisionError):
        examine(tmp_path / "other", 1, NUMBERS, crashes)
