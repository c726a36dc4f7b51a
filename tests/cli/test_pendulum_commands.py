"""Commands given a folder of pendulum recordings: what they do with it, and one line where they
cannot.
"""

import json
import shutil
from pathlib import Path

import numpy as np
import pytest

from rfca_rig.campaign.pendulum import read_pendulum, read_pendulum_file
from rfca_rig.diagnosis.mechanisms.problem import MechanismProblem
from rfca_rig.diagnosis.problem import FitOptions
from rfca_rig.errors import BadInput
from rfca_rig.mechanism.load import load_mechanism
from rfca_rig.model.catalogue import FOLDER_VARIABLE
from rfca_rig.recording.layout import identity_of_tables
from tests.cli.typed import typed
from tests.own_devices.rigs import EXAMPLES

DATA = Path(__file__).parents[1] / "data"
FREE = DATA / "pendulums" / "free-swing"
SIMPLE = DATA / "pendulums" / "geared"
RUNS = ("released at 45 degrees", "released at 90 degrees", "released at 135 degrees")


@pytest.fixture
def say(monkeypatch, capsys, tmp_path):
    """Types a command in an empty folder."""
    monkeypatch.chdir(tmp_path)
    return lambda *words: typed(monkeypatch, capsys, *words)


def test_import_checks_and_copies_what_the_other_commands_read(say, tmp_path):
    recorded = shutil.copytree(FREE, tmp_path / "free-swing")
    (recorded / "LICENSE.txt").write_text("Copyright", encoding="utf-8")
    done = say("import", recorded)
    assert done.exit_code == 0
    copy = tmp_path / "runs" / "IMPORT-free-swing"
    assert f"3 runs of a pendulum in {copy.relative_to(tmp_path)}" in done.err
    for name in ("pendulum.toml", "LICENSE.txt", "runs/release-45.csv"):
        assert (copy / name).read_bytes() == (recorded / name).read_bytes()
    again = say("import", recorded)
    assert again.exit_code == 2 and "is there already" in again.err


def test_check_names_a_torque_of_the_other_sign(say, tmp_path):
    folder = tmp_path / "simple"
    shutil.copytree(SIMPLE, folder)
    usual = say("check", folder)
    assert (usual.exit_code, "WARNING" in usual.out) == (0, False)
    for path in (folder / "runs").glob("*.csv"):
        header, *rows = path.read_text().splitlines()
        torque = header.split(",").index("torque")
        with path.open("w") as file:
            file.write(f"{header}\n")
            for row in rows:
                cells = row.split(",")
                cells[torque] = repr(-float(cells[torque]))
                file.write(f"{','.join(cells)}\n")
    said = say("check", folder)
    assert said.exit_code == 0
    assert "WARNING reading signs and units" in said.out
    assert "sign = -1 in commands[1] (torque)" in " ".join(said.out.split())


def test_import_of_a_faulty_folder_writes_nothing(say, tmp_path):
    shutil.copytree(FREE, tmp_path / "bad")
    (tmp_path / "bad" / "runs" / "release-90.csv").write_text("time_s,angle_rad\n0,nan\n")
    done = say("import", tmp_path / "bad")
    assert done.exit_code == 2
    assert "release-90.csv:2" in done.err and done.err.count("\n") == 1
    assert not (tmp_path / "runs" / "IMPORT-bad").exists()


def test_an_imported_pendulum_is_among_the_runs_with_what_its_diagnosis_said(say, tmp_path):
    say("import", FREE)
    title = read_pendulum(FREE).title
    identity = identity_of_tables(title, tmp_path / "runs" / "IMPORT-free-swing")
    said = {
        "recordings": [{"identity": identity}],
        "effects": [],
        "verdict": "unexplained",
        "grade": "family",
    }
    (tmp_path / "diagnosis").mkdir()
    (tmp_path / "diagnosis" / "diagnosis.json").write_text(json.dumps(said))
    (run,) = json.loads(say("runs", "--json").out)["runs"]
    assert (run["title"], run["kind"], run["source"], run["swings"]) == (
        title,
        "imported",
        "IMPORT",
        3,
    )
    listed = say("runs").out
    assert "3 pendulum runs" in listed and "diagnosis: family" in listed
    (tmp_path / "runs" / "IMPORT-free-swing" / "runs" / "release-45.csv").write_text(
        "time_s,angle_rad\n"
    )
    (tmp_path / "runs" / "IMPORT-free-swing" / "pendulum.toml").touch()
    assert json.loads(say("runs", "--json").out)["runs"][0]["verdict"] is None


def test_a_run_without_a_title_is_listed_as_damaged(say, tmp_path):
    (tmp_path / "runs" / "x").mkdir(parents=True)
    (tmp_path / "runs" / "x" / "pendulum.toml").write_text("format = 1\n")
    (run,) = json.loads(say("runs", "--json").out)["runs"]
    assert run["ended"] == "damaged"


def test_fit_writes_a_model_file_that_report_takes(say, tmp_path):
    fitted = say("fit", FREE, "--out", "model.toml", "--json")
    assert fitted.exit_code == 0
    found = json.loads(fitted.out)
    shifts = {shift["name"]: shift for shift in found["shifts"]}
    inertia = shifts["link1.inertia_about_joint_relative"]
    zero = shifts["joint1.zero_offset_rad"]
    assert len(shifts) == 2
    nominal = read_pendulum_file(FREE)
    model = read_pendulum_file(FREE, model_file=tmp_path / "model.toml")
    factor = model.link1.inertia_kg_m2 / nominal.link1.inertia_kg_m2
    assert factor == pytest.approx(1.0 + inertia["value"], abs=1e-6)
    assert model.known_to.zero_offset_rad == pytest.approx(zero["std"], rel=1e-4)
    assert model.known_to.inertia_relative == pytest.approx(inertia["std"], rel=1e-4)

    reported = say("report", FREE, "--model", "model.toml", "--json", "--out", "report")
    assert reported.exit_code == 0
    before = found["errors"]
    after = json.loads(reported.out)["errors"]
    for one, other in zip(before, after, strict=True):
        assert other["nominal"] == pytest.approx(one["fitted"], rel=0.1)
        assert one["noise"] < one["fitted"] < one["held_out"]
    assert sum(one["fitted"] for one in before) < 0.9 * sum(one["nominal"] for one in before)


def test_fit_writes_a_model_of_mujoco_too(say, tmp_path):
    fitted = say("fit", FREE, "--out", "model.xml", "--json")
    assert fitted.exit_code == 0
    shifts = {shift["name"]: shift["value"] for shift in json.loads(fitted.out)["shifts"]}
    link = read_pendulum_file(FREE).link1
    body = load_mechanism(tmp_path / "model.xml").model.body("link1")
    about_joint = float(body.inertia[1] + body.mass[0] * body.ipos[2] ** 2)
    factor = 1.0 + shifts["link1.inertia_about_joint_relative"]
    assert about_joint == pytest.approx(factor * link.inertia_kg_m2, rel=1e-4)
    before = json.loads(say("report", FREE, "--json", "--out", "nominal").out)["errors"]
    reported = say("report", FREE, "--model", "model.xml", "--json", "--out", "report")
    assert reported.exit_code == 0
    after = json.loads(reported.out)["errors"]
    assert sum(error["nominal"] for error in after) < sum(error["nominal"] for error in before)


def test_report_shows_every_run_with_its_errors(say, tmp_path):
    done = say("report", FREE)
    assert done.exit_code == 0
    page = (tmp_path / "report" / "report.html").read_text()
    assert all(run in page for run in RUNS)
    assert "simulated, fitted values" in page and page.count("<svg") > 3
    rows = (tmp_path / "report" / "mechanism-errors.csv").read_text().splitlines()
    assert len(rows) == 1 + len(RUNS)
    assert rows[0] == "run,signal,unit,noise,nominal,fitted,held_out"


def test_only_the_parameters_that_are_named_are_fitted():
    problem = MechanismProblem(read_pendulum(SIMPLE))
    found = problem.fit(FitOptions(names=["command_delay_s"]), lambda *_: None)
    (shift,) = found.fit.shifts
    assert shift.name == "command_delay_s" and shift.prior_std == 0.004
    assert found.plant.command_delay_s == pytest.approx(shift.value)
    signals = {"joint1_position_rad", "joint1_speed_rad_s"}
    assert {error.signal for error in found.fit.errors} == signals
    assert all(
        np.isfinite(overlay.after).all() and overlay.t_s[0] < overlay.t_s[-1]
        for overlay in found.fit.overlays
    )


def test_a_model_file_of_other_links_is_refused(say, tmp_path):
    say("fit", SIMPLE, "--parameters", "command_delay_s", "--out", "one.toml")
    with pytest.raises(BadInput, match=r"one\.toml: a model of 1 links, but .* has 2"):
        read_pendulum(DATA / "pendulums" / "double", model_file=tmp_path / "one.toml")


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("fit", FREE, "--phases", "free"), "--phases: is an option for recordings of a leg"),
        (
            ("fit", FREE, "--parameters", "k0"),
            "--parameters: 'k0' is no value of [known_to]",
        ),
        (("report", FREE, "--shaft", "recorded"), "--shaft: is an option for recordings of a leg"),
        (
            ("report", FREE, FREE),
            "holds pendulum.toml, which has a model of its own; give it alone",
        ),
        (
            ("diagnose", FREE, "--close-the-loop"),
            "--close-the-loop runs experiments on a leg's rig",
        ),
        (("diagnose", SIMPLE, FREE), "give it alone"),
        (
            ("report", FREE, "--model", FREE / "pendulum.toml"),
            "pendulum.toml:2: title: unknown key; known are format, link1",
        ),
        (
            ("export", "csv", FREE, "--out", "csv"),
            "is a campaign of a pendulum, which this command does not take",
        ),
    ],
)
def test_what_makes_no_sense_for_a_pendulum_is_one_line(say, tmp_path, words, said):
    done = say(*words)
    assert done.exit_code == 2
    assert said in done.err and done.err.count("\n") == 1
    assert list(tmp_path.iterdir()) == []


def test_nothing_to_fit_is_said(say, tmp_path):
    shutil.copytree(FREE, tmp_path / "exact")
    text = (FREE / "pendulum.toml").read_text()
    (tmp_path / "exact" / "pendulum.toml").write_text(
        text.replace("inertia_relative = 0.08", "").replace("zero_offset_rad = 0.01", "")
    )
    done = say("fit", tmp_path / "exact")
    assert done.exit_code == 2 and "[known_to] lists no value that these" in done.err


@pytest.mark.slow
def test_an_effect_of_one_s_own_is_looked_for_where_it_has_a_law_of_joints(
    say, tmp_path, monkeypatch
):
    folder = tmp_path / "effects"
    folder.mkdir()
    shutil.copy(EXAMPLES / "effects" / "our_effect.py", folder)
    text = (folder / "our_effect.py").read_text(encoding="utf-8")
    # The same effect without a law for joints.
    without = text[: text.index("    joint_torque=")] + ")\n"
    (folder / "of_hinges.py").write_text(without.replace("cubic_damping", "of_hinges"))
    monkeypatch.setenv(FOLDER_VARIABLE, str(folder))
    done = say("diagnose", FREE, "--json")
    assert done.exit_code == 0, done.err
    answer = json.loads(done.out)
    assert "cubic_damping" in answer["settings"]["effects_tried"]
    assert "of_hinges" not in answer["settings"]["effects_tried"]
    (remark,) = [text for text in answer["remarks"] if "of_hinges" in text]
    assert remark.startswith("not looked for: effect of_hinges has no joint_torque")
