"""A whole run with an effect of a lab's own, which the recording keeps."""

import json
import runpy
from pathlib import Path

import pytest

from rfca_rig.model.catalogue import FOLDER_VARIABLE
from rfca_rig.recording.store import read_recording
from tests.cli.typed import typed
from tests.own_devices.rigs import EXAMPLES, ROOT, rig_with

NAMED = """
[[effects]]
id = "cubic_damping"
parameters = { coefficient_Nm_s3_per_rad3 = 0.01 }
"""
RUN = ("--height", "215", "--speed", "3.249", "--repeats", "1")


@pytest.mark.long
def test_a_run_whose_twin_has_it_and_whose_model_believes_it(tmp_path, monkeypatch, capsys):
    assert NAMED.strip() in (ROOT / "docs" / "add-an-effect.md").read_text()
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv(FOLDER_VARIABLE, str(EXAMPLES / "effects"))
    rig = rig_with(tmp_path)
    rig.write_text(rig.read_text() + NAMED)
    assert typed(monkeypatch, capsys, "dynamic", "run", "--rig", rig, *RUN).exit_code == 0
    recording = read_recording(Path("runs") / "SIM-flapping-215-mm-3.249-rad-per-s-001" / "run.h5")
    assert recording.nominal["effects"][0]["id"] == "cubic_damping"
    assert (
        recording.provenance["effect_cubic_damping_file"]
        == (EXAMPLES / "effects" / "our_effect.py").read_text()
    )
    t_s, fz_N = recording.strokes[0].channel("fz_N")
    assert t_s[fz_N.argmin()] == pytest.approx(0.831, abs=0.03)


def test_without_its_folder_the_rig_file_is_refused_in_one_line(tmp_path, monkeypatch, capsys):
    rig = rig_with(tmp_path)
    rig.write_text(rig.read_text() + NAMED)
    said = typed(monkeypatch, capsys, "plan", "flapping", "--rig", rig)
    assert said.exit_code == 2
    assert "cubic_damping" in said.err
    assert said.err.count("\n") == 1


def test_the_guide_shows_the_trial_that_is_tested():
    assert (EXAMPLES / "own_effect_trial.py").read_text() in (
        ROOT / "docs" / "add-an-effect.md"
    ).read_text()


@pytest.mark.long
@pytest.mark.timeout(1800)
def test_a_diagnosis_identifies_it_in_recordings_that_hold_it(tmp_path, monkeypatch, capsys):
    pytest.importorskip("xarray")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv(FOLDER_VARIABLE, str(EXAMPLES / "effects"))
    assert typed(monkeypatch, capsys, "init", "--rig", "our-rig.toml", "--yes").exit_code == 0
    runpy.run_path(str(EXAMPLES / "own_effect_trial.py"))
    assert typed(monkeypatch, capsys, "diagnose", "trial", "--out", "diagnosis").exit_code == 0
    found = json.loads(Path("diagnosis", "diagnosis.json").read_text(encoding="utf-8"))
    assert (found["grade"], [effect["id"] for effect in found["effects"]]) == (
        "identified",
        ["cubic_damping"],
    )
    (value,) = (one["value"] for one in found["effects"][0]["parameters"].values())
    assert value == pytest.approx(0.08, rel=0.05)
