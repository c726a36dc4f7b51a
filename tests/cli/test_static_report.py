"""rfca-rig static report, typed."""

import json
from pathlib import Path

import numpy as np
import pytest

from rfca_rig.description.model_file import read_model_file
from rfca_rig.recording.store import write_recording
from tests.analysis.torque_rotation.tables import plain, recording
from tests.campaign.small import copy_to, edit, swap, without_column
from tests.cli.typed import typed, typed_in

SMALL = Path(__file__).parents[1] / "data" / "small-campaign"


@pytest.fixture(scope="module")
def reported(tmp_path_factory):
    """Where the report of the small campaign is, made once, and what the command answers."""
    folder = tmp_path_factory.mktemp("reported")
    return folder / "out", typed_in(folder, "static", "report", SMALL, "--out", "out", "--json")


def test_the_small_campaign_gives_its_hinges_back(reported):
    """Its file says k0 11.0, k2 4.2; the table is of another lab's simulator, with noise."""
    out, said = reported
    assert said.exit_code == 0
    found = json.loads(said.out)
    assert found["k0_Nm_per_rad"]["value"] == pytest.approx(11.0, rel=0.01)
    assert found["k2_per_rad2"]["value"] == pytest.approx(4.2, rel=0.02)
    for name, true in (("k0_Nm_per_rad", 11.0), ("k2_per_rad2", 4.2)):
        low, high = found[name]["interval_95"]
        assert low < true < high
    assert found["remarks"] == []
    assert (out / "static.html").is_file()


@pytest.mark.slow
def test_predict_takes_the_model_that_it_leaves(reported, tmp_path, monkeypatch, capsys):
    model = reported[0] / "model.toml"
    said = typed(
        monkeypatch,
        capsys,
        "predict",
        "--height",
        235,
        "--speed",
        3.276,
        "--model",
        model,
        "--json",
    )
    assert said.exit_code == 0
    assert json.loads(said.out)["valley_fz_N"] == pytest.approx(
        -36.9, abs=0.4
    )  # as with the nominal hinges
    assert (
        typed(monkeypatch, capsys, "dynamic", "run", "--dry-run", "--model", model).exit_code == 0
    )
    assert (
        typed(
            monkeypatch, capsys, "report", SMALL, "--out", tmp_path / "again", "--model", model
        ).exit_code
        == 0
    )
    assert read_model_file(model).known_to.k2_relative < 0.02


@pytest.mark.slow
def test_the_measured_curve_goes_wherever_a_model_goes(reported, tmp_path, monkeypatch, capsys):
    law, curve = (reported[0] / name for name in ("model.toml", "model-curve.toml"))
    valleys = [
        json.loads(
            typed(
                monkeypatch,
                capsys,
                "predict",
                "--height",
                235,
                "--speed",
                3.276,
                "--model",
                model,
                "--json",
            ).out
        )["valley_fz_N"]
        for model in (law, curve)
    ]
    assert valleys[1] == pytest.approx(valleys[0], rel=1e-3)
    assert (
        typed(monkeypatch, capsys, "dynamic", "run", "--dry-run", "--model", curve).exit_code == 0
    )
    assert (
        typed(
            monkeypatch, capsys, "report", SMALL, "--out", tmp_path / "again", "--model", curve
        ).exit_code
        == 0
    )
    assert (
        typed(
            monkeypatch,
            capsys,
            "static",
            "report",
            SMALL,
            "--out",
            tmp_path / "from curve",
            "--model",
            curve,
        ).exit_code
        == 0
    )
    again = read_model_file(tmp_path / "from curve" / "model.toml").leg
    assert again.k0_Nm_per_rad == pytest.approx(read_model_file(law).leg.k0_Nm_per_rad, rel=1e-3)


@pytest.mark.slow
def test_rest_angles_are_found_where_it_is_stated_how_far_they_may_be_off(
    reported, tmp_path, monkeypatch, capsys
):
    model = tmp_path / "model.toml"
    model.write_text(
        (reported[0] / "model.toml")
        .read_text()
        .replace("[known_to]\n", "[known_to]\nrest_angle_deg = 2.0\n")
    )
    said = typed(
        monkeypatch,
        capsys,
        "static",
        "report",
        SMALL,
        "--out",
        tmp_path / "rest",
        "--model",
        model,
        "--marks-deg",
        "0.1",
        "--json",
    )
    found = json.loads(said.out)["rest_angles"]
    assert np.abs(found["deg"]).max() < 4.0 * max(found["std_deg"])
    assert max(found["std_deg"]) < 0.15
    assert found["mean_std_deg"] < 0.08
    assert -1.0 < found["correlation_with_stiffness"] < -0.3
    page = (tmp_path / "rest" / "static.html").read_text()
    assert "rest angle of hinge 7" in page
    assert "The rest angles were found together with the curve" in page
    assert len(read_model_file(tmp_path / "rest" / "model-curve.toml").leg.rest_angles_deg) == 6


@pytest.mark.slow
def test_stated_errors_of_angles_and_gain_are_used(reported, tmp_path, monkeypatch, capsys):
    def half(said):
        low, high = json.loads(said.out)["k0_Nm_per_rad"]["interval_95"]
        return 0.5 * (high - low)

    words = ("static", "report", SMALL, "--out", tmp_path, "--json")
    assert half(typed(monkeypatch, capsys, *words, "--force-gain-pct", 2)) > 4 * half(reported[1])
    stated = typed(monkeypatch, capsys, *words, "--hinge-std-deg", 0.05)
    assert any("times as much as was stated" in one for one in json.loads(stated.out)["remarks"])


def lines_of(monkeypatch, capsys, out, *words):
    said = typed(monkeypatch, capsys, "static", "report", *words, "--out", out)
    assert said.exit_code == 2
    assert not out.exists()
    assert said.err.count("\n") == 1
    return said.err


def test_without_angles_it_says_what_to_do(tmp_path, monkeypatch, capsys):
    campaign = copy_to(tmp_path)
    for hinge in range(2, 8):
        edit(campaign / "runs" / "static.csv", without_column(f"hinge{hinge}_deg"))
    said = lines_of(monkeypatch, capsys, tmp_path / "out", campaign)
    assert "none of its 16 static stages has a hinge angle" in said
    assert "hinge2_deg .. hinge7_deg" in said


def test_what_cannot_go_together_is_refused(tmp_path, monkeypatch, capsys):
    campaign = copy_to(tmp_path)
    edit(campaign / "campaign.toml", swap("k0_Nm_per_rad = 11.0", "k0_Nm_per_rad = 12.0"))
    said = lines_of(monkeypatch, capsys, tmp_path / "out", SMALL, campaign)
    assert "states other nominal values" in said
    assert "--model" in said


@pytest.mark.slow
def test_a_recording_that_believes_nothing_needs_a_model(reported, tmp_path, monkeypatch, capsys):
    write_recording(recording(plain(), sections={}, known_to={}), tmp_path / "run.h5")
    assert "give a model with --model" in lines_of(
        monkeypatch, capsys, tmp_path / "out", tmp_path / "run.h5"
    )
    model = reported[0] / "model.toml"
    assert (
        typed(
            monkeypatch,
            capsys,
            "static",
            "report",
            tmp_path / "run.h5",
            "--model",
            model,
            "--out",
            tmp_path / "out",
        ).exit_code
        == 0
    )


def test_no_such_place(tmp_path, monkeypatch, capsys):
    assert "is not there" in lines_of(monkeypatch, capsys, tmp_path / "out", tmp_path / "nothing")
