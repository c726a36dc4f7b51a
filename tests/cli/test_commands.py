"""Every command as a user types it: results, exit codes, one clear line for a mistake."""

import hashlib
import json
import re
import shutil
import subprocess
import sys
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

import pytest

from rfca_rig.bench.factory import HandRack, open_bench
from rfca_rig.campaign.reading import read_campaign
from rfca_rig.description.model_file import FoundEffect, read_model_file, write_model
from rfca_rig.description.rig_file import read_rig
from rfca_rig.recording.store import read_recording, write_recording
from tests.cli.typed import typed, typed_in

ROOT = Path(__file__).parents[2]
SMALL = ROOT / "tests" / "data" / "small-campaign"
REAL_RIG = ROOT / "tests" / "data" / "real-rig.toml"
REPORT_TABLES = ("table2", "peak-forces", "run-stages", "run-conditions")
REPORT = {
    "strokes-1.csv",
    "report.html",
    "run.html",
    *(f"{name}.{kind}" for name in REPORT_TABLES for kind in ("csv", "tex")),
}
REPORT |= {"table2.json", "peak-forces.json"}
FILES = ["SHA256SUMS", "end.json", "events.jsonl", "run.h5", "run.json", "stages"]
SEED = 7
ONE_STROKE = ("dynamic", "run", "--height", "215", "--speed", "3.249", "--repeats", "1")
HEAVY = ("numpy", "scipy", "numba", "h5py", "matplotlib", "cv2", "can", "pydantic", "jinja2")


@pytest.fixture(scope="module")
def one_stroke(tmp_path_factory):
    """The folder of a run of one stroke, made once."""
    folder = tmp_path_factory.mktemp("one-stroke")
    assert typed_in(folder, *ONE_STROKE, "--seed", SEED).exit_code == 0
    (run,) = (folder / "runs").iterdir()
    return run


@pytest.fixture
def here(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    return tmp_path


def test_help_loads_nothing_heavy():
    code = (
        f"import sys, rfca_rig.cli.main; print([name for name in {HEAVY} if name in sys.modules])"
    )
    assert (
        subprocess.run(
            [sys.executable, "-c", code], capture_output=True, text=True, check=True
        ).stdout.strip()
        == "[]"
    )


@pytest.mark.parametrize(
    "words",
    [
        (),
        ("dynamic",),
        ("dynamic", "run"),
        ("static",),
        ("static", "run"),
        ("import",),
        ("predict",),
        ("report",),
        ("recover",),
        ("check",),
    ],
    ids=" ".join,
)
def test_every_command_explains_itself(monkeypatch, capsys, words):
    said = typed(monkeypatch, capsys, *words, "--help")
    assert said.exit_code == 0
    assert "Usage" in said.out


@pytest.mark.slow
def test_a_dynamic_run_prints_the_plan_the_valleys_and_the_next_command_which_works(
    here, monkeypatch, capsys
):
    said = typed(
        monkeypatch, capsys, "dynamic", "run", "--height", 215, "--speed", 3.249, "--repeats", 2
    )
    assert said.exit_code == 0
    lines = said.err.splitlines()
    assert all(line.startswith("SIM ") for line in lines)
    assert any("limits 300 N" in line and "MB" in line and "min" in line for line in lines)
    assert sum("valley (0.8" in line for line in lines) == 2
    (run,) = (here / "runs").iterdir()
    assert f"next: rfca-rig report runs/{run.name} --out report" in lines[-1]
    assert sorted(file.name for file in run.iterdir()) == FILES
    words = lines[-1].split("next: rfca-rig ")[1].split()
    said = typed(monkeypatch, capsys, *words)
    assert said.exit_code == 0
    assert {file.name for file in (here / "report").iterdir()} == REPORT
    page = (here / "report" / "report.html").read_text()
    assert f"rfca-rig {' '.join(words[:2])}</code>" in page
    assert hashlib.sha256((here / words[1] / "run.h5").read_bytes()).hexdigest() in page


@pytest.mark.slow
def test_json_owns_the_output(here, monkeypatch, capsys):
    said = typed(
        monkeypatch,
        capsys,
        "dynamic",
        "run",
        "--height",
        235,
        "--speed",
        3.276,
        "--repeats",
        1,
        "--json",
    )
    assert said.err == ""
    answer = json.loads(said.out)
    assert answer["source"] == "SIM"
    assert answer["strokes"][0]["valley_fz_N"] == pytest.approx(-39.7, abs=2.0)


@pytest.mark.slow
def test_another_seed_makes_another_run(one_stroke, here, monkeypatch, capsys):
    """That the same seed makes the same is told in test_run_files.py, of all files. The seed
    itself is one of the recorded values.
    """
    typed(monkeypatch, capsys, *ONE_STROKE, "--seed", SEED + 1)
    (other,) = (here / "runs").iterdir()
    first, second = (
        read_recording(run / "run.h5").strokes[0].streams["force"].columns["fz_N"].values
        for run in (one_stroke, other)
    )
    assert (first[:1000] != second[:1000]).mean() > 0.5


def test_a_dry_run_leaves_nothing(here, monkeypatch, capsys):
    said = typed(monkeypatch, capsys, "dynamic", "run", "--protocol", "table2", "--dry-run")
    assert said.exit_code == 0
    assert "20 strokes" in said.err
    assert list(here.iterdir()) == []


@pytest.mark.slow
def test_a_static_run_records_settled_stages(here, monkeypatch, capsys):
    protocol = here / "short.toml"
    text = (Path(__file__).parents[2] / "protocols" / "static-angle.toml").read_text()
    brisk = text.replace("[215.0, 235.0]", "[235.0]").replace(
        "move_speed_rad_s = 0.4", "move_speed_rad_s = 1.6"
    )
    protocol.write_text(brisk.split("[[stages]]\nangle_deg = 90.0")[0])
    said = typed(monkeypatch, capsys, "static", "run", "--protocol", protocol, "--json")
    assert said.exit_code == 0
    stages = json.loads(said.out)["stages"]
    assert [stage["settled"] for stage in stages] == [True, True]
    assert stages[0]["shaft_angle_rad"] == pytest.approx(1.0472, abs=2e-3)
    assert stages[1]["fz_N"] < stages[0]["fz_N"] < 3.0


def test_predict_answers_a_person_and_a_program(monkeypatch, capsys, here):
    spoken = typed(monkeypatch, capsys, "predict", "--height", 215, "--speed", 2.433)
    assert "valley at 1.06" in spoken.out
    answer = json.loads(
        typed(
            monkeypatch,
            capsys,
            "predict",
            "--height",
            215,
            "--speed",
            2.433,
            "--json",
            "--csv",
            here / "p.csv",
        ).out
    )
    assert answer["valley_fz_N"] == pytest.approx(-54.64, abs=0.1)
    assert (here / "p.csv").read_text().startswith("t_s,shaft_angle_rad")


def test_a_leg_that_never_touches_is_said_so(monkeypatch, capsys):
    said = typed(monkeypatch, capsys, "predict", "--height", 400, "--speed", 2)
    assert "never touches the ground, no valley" in said.out


@pytest.mark.slow
def test_import_then_report_equals_reporting_the_folder_itself(here, monkeypatch, capsys):
    assert typed(monkeypatch, capsys, "import", SMALL).exit_code == 0
    assert (
        typed(monkeypatch, capsys, "report", "runs/IMPORT-small-campaign", "--out", "a").exit_code
        == 0
    )
    assert typed(monkeypatch, capsys, "report", SMALL, "--out", "b").exit_code == 0
    for name in sorted(REPORT):
        one, other = (
            (here / folder / name).read_text().partition("<footer>")[0] for folder in "ab"
        )
        # The page names the command that diagnoses what it shows, so its path.
        one, other = (re.sub(r"(rfca-rig diagnose )[^<]*", r"\1", text) for text in (one, other))
        assert one == other, name


@pytest.mark.slow
def test_twin_and_import_in_one_report(one_stroke, here, monkeypatch, capsys):
    said = typed(monkeypatch, capsys, "report", SMALL, one_stroke, "--out", "both", "--json")
    assert json.loads(said.out)["format"] == "rfca-table2/1"
    page = (here / "both" / "report.html").read_text()
    assert "SIM" in page
    assert "IMPORT" in page


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("dynamic", "run", "--height", "215"), "--height and --speed together"),
        (("dynamic", "run", "--height", "-5", "--speed", "2"), "height_mm"),
        (("dynamic", "run", "--height", "abc", "--speed", "2"), "--height"),
        (
            ("dynamic", "run", "--height", "215", "--speed", "25"),
            "above the rig's limit of 20 rad/s",
        ),
        (("dynamic", "run", "--height", "100", "--speed", "15"), "the model expects"),
        (("dynamic", "run", "--repeats", "0"), "--repeats"),
        (
            ("dynamic", "run", "--protocol", "nonsense"),
            "there are bending, fatigue, flapping, impact, static-angle, table2",
        ),
        (("dynamic", "run", "--protocol", "static-angle"), "experiment"),
        (("dynamic", "run", "--rig", "nowhere.toml"), "nowhere.toml"),
        (("static", "run", "--protocol", "flapping"), "experiment"),
        (("import", "nowhere"), "nowhere"),
        (("report", "nowhere"), "nowhere"),
        (("report",), "PATH"),
        (("predict", "--height", "215", "--speed", "2", "--model", "nowhere.toml"), "nowhere.toml"),
        (("recover", "nowhere"), "nowhere"),
        (("resume", "nowhere"), "nowhere"),
        (("check", "nowhere"), "nowhere"),
        (("predict", "--height", "215"), "--speed"),
        (("predict", "--height", "0", "--speed", "1"), "--height"),
        (("nonsense",), "No such command"),
    ],
    ids=lambda value: " ".join(value) if isinstance(value, tuple) else "",
)
def test_a_mistake_gets_one_line_exit_code_2_and_changes_nothing(
    here, monkeypatch, capsys, words, said
):
    answer = typed(monkeypatch, capsys, *words)
    assert answer.exit_code == 2
    mine = [line for line in answer.err.splitlines() if not line.startswith("SIM")]
    assert len(mine) == 1
    assert mine[0].startswith("rfca-rig: ")
    assert said in mine[0]
    assert list(here.iterdir()) == []


def slippery(here):
    """A model file that no recording believes: half the friction, and a rack that stands 1 mm
    higher.
    """
    sections = read_rig(ROOT / "calibration" / "twin.toml").nominal()
    sections["ground"]["friction_coefficient"] = 0.2
    write_model(
        here / "slippery.toml",
        sections,
        {"height_mm": 0.05},
        [],
        [FoundEffect("height_offset", {"offset_mm": 1.0})],
    )
    return here / "slippery.toml"


@pytest.mark.slow
def test_a_model_file_takes_the_place_of_the_believed_one(here, monkeypatch, capsys):
    model = slippery(here)
    words = ("--height", 215, "--speed", 3.249)
    plain = json.loads(typed(monkeypatch, capsys, "predict", *words, "--json").out)
    given = json.loads(
        typed(monkeypatch, capsys, "predict", *words, "--model", model, "--json").out
    )
    assert given["valley_fz_N"] < plain["valley_fz_N"] - 10.0

    said = typed(
        monkeypatch,
        capsys,
        "dynamic",
        "run",
        *words,
        "--repeats",
        1,
        "--model",
        model,
        "--report",
        "own",
        "--json",
    )
    assert said.exit_code == 0
    run = Path(json.loads(said.out)["run"])
    recording = read_recording(run / "run.h5")
    assert recording.nominal["ground"]["friction_coefficient"] == 0.2
    assert recording.nominal["effects"] == [
        {"id": "height_offset", "parameters": {"offset_mm": 1.0}}
    ]
    assert recording.known_to == {"height_mm": 0.05}
    assert recording.provenance["model_file"] == model.read_text()
    (row,) = json.loads((here / "own" / "table2.json").read_text())["rows"]
    assert row["measured_fz_N"] == pytest.approx(plain["valley_fz_N"], abs=1.5), (
        "the twin is what it was"
    )
    assert row["simulated_fz_N"] == pytest.approx(given["valley_fz_N"], abs=1.5)


def test_the_plan_is_held_against_the_given_model(here, monkeypatch, capsys):
    words = ("--height", 215, "--speed", 3.249, "--dry-run")
    expects = r"expects up to (\d+) N"
    plain = typed(monkeypatch, capsys, "dynamic", "run", *words).err
    given = typed(monkeypatch, capsys, "dynamic", "run", *words, "--model", slippery(here)).err
    assert int(re.search(expects, given)[1]) > int(re.search(expects, plain)[1]) + 10
    given = typed(monkeypatch, capsys, "static", "run", "--dry-run", "--model", slippery(here)).err
    plain = typed(monkeypatch, capsys, "static", "run", "--dry-run").err
    assert re.findall(expects, given) != re.findall(expects, plain)


@pytest.mark.slow
def test_a_report_against_a_model_file_says_so(one_stroke, here, monkeypatch, capsys):
    model = slippery(here)
    run = shutil.copytree(one_stroke, "run")
    plain = json.loads(typed(monkeypatch, capsys, "report", run, "--json").out)
    given = json.loads(typed(monkeypatch, capsys, "report", run, "--model", model, "--json").out)
    assert given["average"]["force_error_pct"] > plain["average"]["force_error_pct"] + 10.0
    page = (here / "report" / "report.html").read_text()
    assert "The model in slippery.toml, given for this report" in page
    assert str(here) not in page


@pytest.mark.slow
def test_a_fitted_model_file_is_one(one_stroke, here, monkeypatch, capsys):
    said = typed(
        monkeypatch, capsys, "fit", one_stroke, "--parameters", "height,k0", "--out", "fitted.toml"
    )
    assert said.exit_code == 0
    assert (
        typed(
            monkeypatch,
            capsys,
            "predict",
            "--height",
            215,
            "--speed",
            2.433,
            "--model",
            "fitted.toml",
        ).exit_code
        == 0
    )
    assert read_model_file(here / "fitted.toml").effects[0].id == "height_offset"


def test_a_recording_whose_belief_makes_no_model_is_named(here, monkeypatch, capsys):
    recording = replace(read_campaign(SMALL), nominal={"leg": {}})
    write_recording(recording, here / "old.h5")
    for command in ("report", "fit"):
        answer = typed(monkeypatch, capsys, command, SMALL, "old.h5")
        assert (answer.exit_code, len(answer.err.splitlines())) == (2, 1)
        assert "rfca-rig: old.h5: the nominal model: " in answer.err
    assert typed(monkeypatch, capsys, "report", "old.h5", "--model", slippery(here)).exit_code == 0


def test_a_broken_campaign_leaves_nothing_behind(here, monkeypatch, capsys):
    broken = here / "broken"
    shutil.copytree(SMALL, broken)
    victim = next((broken / "runs").glob("dynamic*.csv"))
    victim.write_text(victim.read_text().replace("fz_N", "fz_kN", 1))
    answer = typed(monkeypatch, capsys, "import", broken)
    assert answer.exit_code == 2
    assert len(answer.err.splitlines()) == 1
    assert victim.name in answer.err
    assert not (here / "runs").exists()


def test_a_trip_has_its_own_exit_code(here, monkeypatch, capsys):
    rig = here / "careful.toml"
    text = (Path(__file__).parents[2] / "calibration" / "twin.toml").read_text()
    rig.write_text(
        text.replace("following_error_deg = 20.0", "following_error_deg = 1.0").replace(
            "s_per_rad = 8.0 ", "s_per_rad = 0.0 "
        )
    )
    answer = typed(
        monkeypatch, capsys, "dynamic", "run", "--height", 215, "--speed", 3.249, "--rig", rig
    )
    assert answer.exit_code == 3
    assert "deg from where it should be" in answer.err.splitlines()[-1]
    assert answer.err.endswith("; more: rfca-rig trip F-02\n")
    (run,) = (here / "runs").iterdir()
    kept = (
        "kept 0 strokes and 0 static stages, and flap 215 mm, 3.249 rad/s, repeat 1 until it "
        "was cut short, in"
    )
    assert (
        f"{kept} runs/{run.name}; rfca-rig resume runs/{run.name} --after-trip goes on"
        in answer.err
    )
    (until_then,) = read_recording(run / "run.h5").raw
    assert "deg from where it should be" in until_then.cut_short


def test_a_mistake_of_ours_is_admitted_in_one_line(monkeypatch, capsys):
    monkeypatch.setattr("rfca_rig.cli.paths.find_file", lambda *_: 1 / 0)
    answer = typed(monkeypatch, capsys, "predict", "--height", 215, "--speed", 2)
    assert answer.exit_code == 1
    assert "a mistake in rfca-rig, not yours: ZeroDivisionError" in answer.err


@contextmanager
def twin_that_counts_as_real(rig, *_):
    with open_bench(read_rig(ROOT / "calibration" / "twin.toml"), 1) as bench:
        yield replace(bench, rack=HandRack(), is_real=True)


def test_an_input_that_ends_before_the_rack_is_set_is_one_clear_line(here, monkeypatch, capsys):
    def ended(_prompt):
        raise EOFError

    monkeypatch.setattr("typer.prompt", lambda *_, **__: "320")
    monkeypatch.setattr("builtins.input", ended)
    monkeypatch.setattr("rfca_rig.cli.run_experiment.open_bench", twin_that_counts_as_real)
    answer = typed(
        monkeypatch, capsys, "dynamic", "run", "--rig", REAL_RIG, "--height", 215, "--speed", 2
    )
    assert answer.exit_code == 2
    assert re.search(
        r"REAL the drive's watchdog stops the motor after 0\.\d+ s of silence", answer.err
    )
    assert answer.err.splitlines()[-1].startswith(
        "rfca-rig: the input ended before the rack was confirmed to stand at 215.0 mm"
    )
    assert list((here / "runs").iterdir()) == []


def test_real_hardware_asks_for_the_limit_and_moves_nothing_without_it(here, monkeypatch, capsys):
    monkeypatch.setattr("typer.prompt", lambda *_, **__: "yes")
    answer = typed(
        monkeypatch, capsys, "dynamic", "run", "--rig", REAL_RIG, "--height", 215, "--speed", 2
    )
    assert answer.exit_code == 2
    assert "not armed: the force limit is 320 N" in answer.err
    assert all(line.startswith(("REAL", "rfca-rig: ")) for line in answer.err.splitlines())
    assert list(here.iterdir()) == []
