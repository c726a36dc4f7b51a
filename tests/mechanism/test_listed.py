"""Experiments among the runs that are listed, and what `import` says of them."""

import json
import shutil

import pytest
from typer.testing import CliRunner

from rfca_rig.cli.main import app
from rfca_rig.errors import BadInput
from tests.mechanism.test_diagnose import NOMINAL, campaign


@pytest.fixture(scope="module")
def short(tmp_path_factory):
    return campaign(tmp_path_factory.mktemp("listed") / "arm", NOMINAL, seconds=1.4, seeds=(0, 1))


@pytest.fixture(scope="module")
def diagnosed(short, tmp_path_factory):
    """The folder of a diagnosis of these recordings, which is known by their content, wherever
    they lie.
    """
    out = tmp_path_factory.mktemp("diagnosed") / "diagnosis"
    ran = CliRunner().invoke(app, ["diagnose", str(short), "--out", str(out)])
    assert ran.exit_code == 0, ran.output
    return out


def listed(folder, *options):
    ran = CliRunner().invoke(app, ["runs", "--runs", str(folder), *options])
    assert ran.exit_code == 0, ran.output
    return ran.output


def test_an_experiment_is_listed_with_its_recordings_conditions_and_length(short, tmp_path):
    shutil.copytree(short, tmp_path / "lab" / "arm")
    (row,) = json.loads(listed(tmp_path, "--json"))["runs"]
    assert (row["title"], row["source"], row["kind"]) == ("arm", "IMPORT", "imported")
    assert (row["motions"], row["named_conditions"]) == (2, ["sines 1", "sines 2"])
    assert row["seconds"] == pytest.approx(2.8, abs=0.01)
    text = listed(tmp_path)
    assert "2 recordings; 2.8 s; conditions: sines 1, sines 2" in text
    assert "lab/arm" in text
    assert listed(tmp_path, "--kind", "imported") == text


def test_a_recording_that_changes_is_read_again(short, tmp_path):
    folder = shutil.copytree(short, tmp_path / "arm")
    listed(tmp_path)
    rows = (folder / "run2.csv").read_text(encoding="utf-8").splitlines()
    (folder / "run2.csv").write_text("\n".join(rows[: len(rows) // 2]) + "\n", encoding="utf-8")
    assert "2.09 s" in listed(tmp_path)


def test_an_experiment_that_cannot_be_read_is_listed_without_its_length(short, tmp_path):
    folder = shutil.copytree(short, tmp_path / "arm")
    (folder / "run2.csv").unlink()
    assert "2 recordings; cannot be read, see rfca-rig check" in listed(tmp_path)
    (folder / "experiment.toml").write_text('title = "a draft', encoding="utf-8")
    assert "damaged" in listed(tmp_path)


@pytest.mark.slow
@pytest.mark.parametrize("place", ["diagnosis", "arm/diagnosis"])
def test_the_verdict_of_a_diagnosis_beside_it_or_in_it_is_listed(
    short, diagnosed, tmp_path, monkeypatch, place
):
    shutil.copytree(short, tmp_path / "runs" / "arm")
    monkeypatch.chdir(tmp_path)
    shutil.copytree(diagnosed, tmp_path / ("runs" if "/" in place else "") / place)
    assert "diagnosis: not enough data" in listed(tmp_path / "runs")


def test_import_says_in_one_line_that_an_experiment_needs_none(short, tmp_path):
    ran = CliRunner().invoke(app, ["import", str(short), "--out", str(tmp_path / "out")])
    assert isinstance(ran.exception, BadInput)
    assert (
        "holds experiment.toml, which every command reads as it stands; go on with "
        f"rfca-rig check {short}"
    ) in str(ran.exception)
    assert not (tmp_path / "out").exists()
