"""rfca-rig paper: section IV of the paper from one command, on recordings and on the twin."""

import csv
import json
import re
import shutil
from pathlib import Path

import pytest

from rfca_rig.analysis.mujoco_leg import load_mujoco
from rfca_rig.errors import BadInput
from rfca_rig.exam.cases import PAPER_CONDITIONS
from rfca_rig.exam.simulate_campaign import write_campaign
from rfca_rig.recording.store import read_recording
from tests.benchmarks.paper import draw
from tests.cli.typed import typed, typed_in

ROOT = Path(__file__).parents[2]
RIG = ROOT / "calibration" / "twin.toml"
LETTERS = "cdef"
# Two conditions and a few stages: enough for every step.
STATIC = (ROOT / "protocols" / "static-angle.toml").read_text()
STAGES = STATIC.partition("[[stages]]")[0].replace("[215.0, 235.0]", "[215.0]") + "".join(
    f'[[stages]]\nangle_deg = {angle}\ndirection = "loading"\n\n' for angle in (75.0, 105.0, 130.0)
)
DYNAMIC = (ROOT / "protocols" / "table2.toml").read_text()
STROKES = (
    DYNAMIC.partition("[[conditions]]")[0]
    .replace('title = "Table II"', 'title = "two conditions"')
    .replace("repeats = 5", "repeats = 2")
    + "[[conditions]]\nheight_mm = 215.0\nspeed_rad_s = 3.249\n\n"
    + "[[conditions]]\nheight_mm = 235.0\nspeed_rad_s = 2.478\n"
)


@pytest.fixture(scope="module")
def campaign(tmp_path_factory):
    """A campaign of another simulator: a leg whose values differ from the nominal ones."""
    folder = tmp_path_factory.mktemp("recorded") / "campaign"
    write_campaign(draw(1, 3, 0.0), folder)
    return folder


@pytest.fixture(scope="module")
def written(campaign, tmp_path_factory):
    """The folder that paper writes for it, and what it prints."""
    folder = tmp_path_factory.mktemp("paper")
    said = typed_in(folder, "paper", campaign, "--out", "paper")
    assert said.exit_code == 0, said.err
    return folder / "paper", said


@pytest.mark.slow
def test_page_figures_and_tables_are_there_in_the_order_of_the_paper(written):
    folder, _ = written
    page = (folder / "paper.html").read_text()
    assert len(PAPER_CONDITIONS.conditions) == len(LETTERS)
    labels = ("215 mm, 2.433", "235 mm, 2.478", "215 mm, 3.249", "235 mm, 3.276")
    for letter, label in zip(LETTERS, labels, strict=True):
        assert f"<h3>({letter}) {label} rad/s</h3>" in page
    for letter in "bcdef":
        for ending in ("svg", "pdf", "csv"):
            file = folder / "figures" / f"fig-7{letter}.{ending}"
            assert file.stat().st_size > 1000
            assert f'href="figures/fig-7{letter}.{ending}"' in page
    for name in ("table1", "table2", "predicted-valleys"):
        for ending in ("csv", "tex"):
            assert f'href="{name}.{ending}"' in page
            assert (folder / f"{name}.{ending}").is_file()


@pytest.mark.slow
def test_terminal_page_json_and_csv_state_the_same_numbers(written):
    folder, said = written
    document = json.loads((folder / "paper.json").read_text())
    page = (folder / "paper.html").read_text()
    along = document["along_recorded_shaft"]
    errors = (
        f"{along['average_time_error_pct']:.1f} % in time, "
        f"{along['average_force_error_pct']:.1f} % in force"
    )
    assert f"along the recorded shaft: {errors}" in said.err
    assert f"the valley is met to {errors}</h1>" in page.replace("\u00a0", " ")
    inside = document["measured_values_in_95_interval"]
    assert f"{inside} of {document['measured_values']} measured values" in said.err
    rows = list(csv.DictReader((folder / "predicted-valleys.csv").read_text().splitlines()))
    answers = [row[name] for row in rows for name in ("time_inside", "fz_inside")]
    assert answers.count("yes") == inside
    assert len(answers) == document["measured_values"]
    heights_and_speeds = [(float(row["height_mm"]), float(row["speed_rad_s"])) for row in rows]
    assert heights_and_speeds == sorted(heights_and_speeds)
    # Table II beside it is that of the report.
    beside = (folder / "report" / "table2.csv").read_text().splitlines()
    own = (folder / "table2.csv").read_text().splitlines()
    assert [line.split(",")[:12] for line in own] == [line.split(",")[:12] for line in beside]


@pytest.mark.slow
def test_the_interval_is_that_of_the_figure(written):
    folder, _ = written
    document = json.loads((folder / "paper.json").read_text())
    for row in document["predicted"]:
        for quantity, unit in (("time", "s"), ("fz", "N")):
            apart = abs(row[f"measured_{quantity}_{unit}"] - row[f"predicted_{quantity}_{unit}"])
            is_inside = apart <= row[f"predicted_{quantity}_half_{unit}"]
            assert row[f"{quantity}_inside"] == ("yes" if is_inside else "no")


@pytest.mark.slow
def test_the_springs_are_those_of_the_stages_and_not_of_the_nominal_model(written):
    folder, _ = written
    document = json.loads((folder / "paper.json").read_text())
    static = json.loads((folder / "static-report" / "static.json").read_text())
    assert document["k0_Nm_per_rad"] == static["k0_Nm_per_rad"]["value"]
    true_k0 = 11.0 * draw(1, 3, 0.0).off.k0_factor
    assert document["k0_Nm_per_rad"] == pytest.approx(true_k0, rel=0.01)
    assert abs(true_k0 - 11.0) > 0.1


@pytest.mark.slow
def test_the_same_recordings_give_the_same_bytes(campaign, written, tmp_path, monkeypatch, capsys):
    folder, _ = written
    monkeypatch.chdir(tmp_path)
    assert typed(monkeypatch, capsys, "paper", campaign, "--out", "paper").exit_code == 0
    for file in sorted(path for path in folder.rglob("*") if path.is_file()):
        again = tmp_path / "paper" / file.relative_to(folder)
        assert again.read_bytes() == file.read_bytes(), file.name


@pytest.mark.slow
def test_without_mujoco_the_page_says_why_there_is_no_cross_check(
    campaign, tmp_path, monkeypatch, capsys
):
    def missing():
        raise BadInput("MuJoCo is not installed: pip install it")

    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("rfca_rig.analysis.mujoco_leg.load_mujoco", missing)
    said = typed(monkeypatch, capsys, "paper", campaign, "--json")
    assert said.exit_code == 0
    document = json.loads(said.out)
    assert document["against_mujoco_pct"] is None
    assert document["not_checked"] == "MuJoCo is not installed: pip install it"
    assert "Left out: MuJoCo is not installed" in (tmp_path / "paper" / "paper.html").read_text()
    assert not (tmp_path / "paper" / "figures" / "fig-7a.svg").exists()


@pytest.mark.slow
def test_with_mujoco_the_contact_force_is_compared(written):
    try:
        load_mujoco()
    except BadInput:
        pytest.skip("MuJoCo is not installed")
    folder, said = written
    document = json.loads((folder / "paper.json").read_text())
    assert document["against_mujoco_pct"] < 0.1
    assert "contact force against MuJoCo" in said.err
    assert (folder / "figures" / "fig-7a.csv").read_text().startswith("height_mm,speed_rad_s,t_s,")


def test_recordings_without_one_kind_are_one_line(campaign, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    no_stages = tmp_path / "no-stages"
    shutil.copytree(campaign, no_stages)
    text = (no_stages / "campaign.toml").read_text()
    entries = text.split("[[runs]]")
    (no_stages / "campaign.toml").write_text(
        "[[runs]]".join(entry for entry in entries if '"static"' not in entry)
    )
    (no_stages / "runs" / "static.csv").unlink()
    said = typed(monkeypatch, capsys, "paper", no_stages)
    assert said.exit_code == 2
    assert "static stages with hinge angles" in said.err
    assert "Traceback" not in said.err
    assert not (tmp_path / "paper").exists()


def test_a_rig_without_a_camera_is_one_line(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    text = RIG.read_text()
    (tmp_path / "blind.toml").write_text(text[: text.index("\n[camera]")])
    said = typed(monkeypatch, capsys, "paper", "--rig", "blind.toml")
    assert said.exit_code == 2
    assert "has no [camera]" in said.err
    assert not (tmp_path / "paper").exists()


def test_a_wrong_protocol_is_one_line_before_anything_is_made(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "wrong.toml").write_text(DYNAMIC.replace("repeats = 5", "repeats = 0"))
    for words in (("--protocol", "wrong.toml"), ("--static-protocol", "table2")):
        said = typed(monkeypatch, capsys, "paper", *words)
        assert said.exit_code == 2
        assert len(said.err.splitlines()) <= 2
        assert not (tmp_path / "paper").exists()


@pytest.fixture(scope="module")
def measured(tmp_path_factory):
    """The whole work on the twin, with short protocols; where it was done, and what was said."""
    folder = tmp_path_factory.mktemp("twin")
    (folder / "stages.toml").write_text(STAGES)
    (folder / "strokes.toml").write_text(STROKES)
    said = typed_in(folder, *MEASURE)
    assert said.exit_code == 0, said.err
    return folder, said


MEASURE = ("paper", "--static-protocol", "stages.toml", "--protocol", "strokes.toml")


@pytest.mark.long
def test_the_twin_is_measured_from_the_board_to_the_page(measured):
    folder, said = measured
    document = json.loads((folder / "paper" / "paper.json").read_text())
    assert document["along_recorded_shaft"]["average_time_error_pct"] < 1.0
    assert document["along_recorded_shaft"]["average_force_error_pct"] < 1.0
    assert document["measured_values_in_95_interval"] == document["measured_values"] == 4
    static, dynamic = sorted((folder / "paper" / "runs").iterdir())
    camera = (folder / "paper" / "camera.toml").read_text()
    assert read_recording(static / "run.h5").provenance["camera_file"] == camera
    # The strokes were planned with the measured springs.
    nominal = read_recording(dynamic / "run.h5").nominal
    assert nominal["leg"]["k0_Nm_per_rad"] == pytest.approx(document["k0_Nm_per_rad"], abs=1e-6)
    assert (
        f"next: rfca-rig diagnose {dynamic.relative_to(folder)} --out paper/diagnosis" in said.err
    )
    page = (folder / "paper" / "paper.html").read_text()
    for command in ("calibrate camera", "static run", "static report", "dynamic run", "crosscheck"):
        assert f"<code>rfca-rig {command}" in page


@pytest.mark.long
def test_the_same_command_takes_what_is_recorded(measured, monkeypatch, capsys):
    folder, _ = measured
    monkeypatch.chdir(folder)
    before = (folder / "paper" / "paper.html").read_bytes()
    said = typed(monkeypatch, capsys, *MEASURE)
    assert said.exit_code == 0
    assert said.err.count("recorded already") == 2
    assert len(list((folder / "paper" / "runs").iterdir())) == 2
    assert (folder / "paper" / "paper.html").read_bytes() == before


@pytest.mark.long
def test_a_run_that_was_stopped_is_continued(measured, tmp_path, monkeypatch, capsys):
    folder, _ = measured
    monkeypatch.chdir(tmp_path)
    for name in ("stages.toml", "strokes.toml"):
        shutil.copy(folder / name, tmp_path)
    shutil.copytree(folder / "paper", tmp_path / "paper")
    dynamic = next((tmp_path / "paper" / "runs").glob("*two-conditions*"))
    shutil.rmtree(dynamic)
    said = typed(
        monkeypatch,
        capsys,
        "dynamic",
        "run",
        "--protocol",
        "strokes.toml",
        "--model",
        "paper/static-report/model.toml",
        "--runs",
        "paper/runs",
        "--fault",
        "force-silent@8",
    )
    assert said.exit_code == 3
    refused = typed(monkeypatch, capsys, *MEASURE)
    assert refused.exit_code == 2
    assert "--after-trip" in refused.err
    said = typed(monkeypatch, capsys, *MEASURE, "--after-trip")
    assert said.exit_code == 0, said.err
    assert len(read_recording(dynamic / "run.h5").strokes) == 4
    assert re.search(r"4 of 4 measured values", said.err)


@pytest.mark.long
def test_another_rig_file_is_refused(measured, tmp_path, monkeypatch, capsys):
    folder, _ = measured
    monkeypatch.chdir(tmp_path)
    for name in ("stages.toml", "strokes.toml"):
        shutil.copy(folder / name, tmp_path)
    shutil.copytree(folder / "paper", tmp_path / "paper")
    (tmp_path / "own.toml").write_text(RIG.read_text().replace("noise_N = 0.12", "noise_N = 0.13"))
    shutil.copy(RIG.parent / "twin-camera.toml", tmp_path)
    said = typed(monkeypatch, capsys, *MEASURE, "--rig", "own.toml")
    assert said.exit_code == 2
    assert "was recorded with another rig file than own.toml; give another --out" in said.err
