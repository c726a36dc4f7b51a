"""A run's files as a user meets them: recovered after a crash, checked, kept when the disk is
full, and where they come from.
"""

import getpass
import hashlib
import json
import re
import shutil
import subprocess
import sys
import time
from datetime import datetime
from pathlib import Path
from types import SimpleNamespace

import pytest

from rfca_rig.errors import BadInput
from rfca_rig.recording.run_text import check_not_running
from rfca_rig.recording.store import read_recording
from tests.cli.test_commands import FILES, ROOT
from tests.cli.typed import typed, typed_in
from tests.recording.dying import FullDisk, instead


@pytest.fixture
def here(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    return tmp_path


def test_an_interrupted_run_is_recovered_and_what_it_says_to_type_next_works(
    here, monkeypatch, capsys
):
    typed(monkeypatch, capsys, "dynamic", "run", "--height", 215, "--speed", 3.249, "--repeats", 2)
    (whole,) = (here / "runs").iterdir()
    shutil.copytree(whole, here / "crashed")
    for name in ("run.h5", "end.json", "SHA256SUMS", "stages/0002.h5"):
        (here / "crashed" / name).unlink()
    said = typed(monkeypatch, capsys, "recover", "crashed")
    assert said.exit_code == 0
    assert "SIM recovered 1 strokes and 0 static stages in crashed/run.h5" in said.err
    assert sorted(file.name for file in (here / "crashed").iterdir()) == FILES
    assert (
        read_recording(here / "crashed" / "run.h5")
        .provenance["interrupted"]
        .endswith("after 1 strokes and 0 static stages")
    )
    assert typed(monkeypatch, capsys, *said.err.split("next: rfca-rig ")[1].split()).exit_code == 0
    again = typed(monkeypatch, capsys, "recover", "crashed/run.h5")
    assert (again.exit_code, len(again.err.splitlines())) == (2, 1)
    assert "restore stages/0002.h5 from a copy" in again.err


@pytest.mark.slow
def test_a_disk_that_fills_up_stops_the_run_in_one_line_and_the_rest_is_kept(
    here, monkeypatch, capsys
):
    disk = FullDisk(here, 5_300_000)
    monkeypatch.setattr("rfca_rig.cli.run_experiment.can_be_started", lambda: False)
    with instead(disk):
        answer = typed(
            monkeypatch, capsys, "dynamic", "run", "--height", 215, "--speed", 3.249, "--repeats", 4
        )
    assert answer.exit_code == 1
    assert answer.err.splitlines()[-1].startswith("rfca-rig: stopped: disk full: ")
    (run,) = (here / "runs").iterdir()
    recording = read_recording(run / "run.h5")
    assert 1 <= len(recording.strokes) < 4
    assert recording.provenance["ended"].startswith("stopped: disk full")
    assert typed(monkeypatch, capsys, "check", run).exit_code == 0


def test_a_disk_without_room_for_the_plan_is_told_before_anything_moves(here, monkeypatch, capsys):
    monkeypatch.setattr("shutil.disk_usage", lambda _: SimpleNamespace(free=10**6))
    answer = typed(monkeypatch, capsys, "dynamic", "run", "--height", 215, "--speed", 3.249)
    assert answer.exit_code == 2
    assert "1 MB free, the run may need" in answer.err.splitlines()[-1]
    assert list(here.iterdir()) == []


@pytest.mark.slow
def test_a_run_says_where_it_comes_from(here, monkeypatch, capsys):
    run = Path(
        json.loads(
            typed(
                monkeypatch,
                capsys,
                "dynamic",
                "run",
                "--height",
                215,
                "--speed",
                3.249,
                "--repeats",
                1,
                "--json",
            ).out
        )["run"]
    )
    known = read_recording(run / "run.h5").provenance
    assert (
        known["rig_file_sha256"]
        == hashlib.sha256((ROOT / "calibration" / "twin.toml").read_bytes()).hexdigest()
    )
    assert (known["motor_source"], known["sensor_source"], known["seed"], known["ended"]) == (
        "SIM",
        "SIM",
        "1",
        "done",
    )
    assert [stage["stage"] for stage in json.loads(known["plan"])].count("Flap") == 1
    assert json.loads(known["limits"])["force_N"] == 300.0
    assert float(known["worst_loop_gap_ms"]) == pytest.approx(10.0, abs=0.1)
    assert re.fullmatch(
        r"the shaft turned by [\d.]+ deg after the torque was gone, and .*", known["standstill"]
    )
    assert re.fullmatch(
        r"0\.\d+ N, 0\.\d+ N m from the first rest in the air to the last", known["tare_drift"]
    )
    events = [json.loads(line) for line in known["events"].splitlines()]
    told = ["run begins", "tare", "stage begins", "stage recorded", "motor off", "run ends"]
    assert [event["event"] for event in events if event["event"] != "first stroke"] == told
    for name in (
        "numpy_version",
        "hdf5_version",
        "host",
        "started_at",
        "ended_at",
        "sensor_records",
        "git_revision",
        "git_dirty",
    ):
        assert known[name]
    assert (known["operator"], known["sample"]) == (getpass.getuser(), "")
    assert (known["exit_status"], known["reason"]) == ("0", "done")
    by_name = {event["event"]: event for event in events}
    assert known["ended_in_stage"] == f"after {by_name['stage begins']['stage']}"
    assert (
        known["recorder_samples"]
        == f"{sum(by_name['stage recorded']['samples'].values())} handed over, 0 refused"
    )
    clocks = [
        (event["t_s"], datetime.fromisoformat(event["utc"])) for event in events if "utc" in event
    ]
    assert len(clocks) >= 3
    assert all(moment.tzinfo for _, moment in clocks)


@pytest.fixture(scope="module")
def alike(tmp_path_factory):
    """The folders of two runs of the same words."""
    folder = tmp_path_factory.mktemp("alike")
    words = (
        "--height",
        215,
        "--speed",
        3.249,
        "--repeats",
        2,
        "--seed",
        7,
        "--operator",
        "M. Kölle",
        "--sample",
        "leg 7",
    )
    for _ in range(2):
        assert typed_in(folder, "dynamic", "run", *words).exit_code == 0
    return sorted((folder / "runs").iterdir())


@pytest.mark.slow
def test_who_was_at_the_rig_and_with_which_specimen_is_as_was_said(alike):
    known = read_recording(alike[0] / "run.h5").provenance
    assert (known["operator"], known["sample"]) == ("M. Kölle", "leg 7")


@pytest.mark.slow
def test_a_simulated_run_is_the_same_in_every_byte_of_every_file(alike):
    one, other = alike
    names = names_in(one)
    assert names == names_in(other)
    assert [
        name for name in names if (one / name).read_bytes() != (other / name).read_bytes()
    ] == []


def names_in(run):
    return sorted(file.relative_to(run).as_posix() for file in run.rglob("*") if file.is_file())


@pytest.mark.slow
@pytest.mark.skipif(sys.platform == "win32", reason="no signal that cannot be caught")
def test_a_run_killed_without_warning_is_recovered_with_the_stage_that_was_in_progress(here):
    code = "from rfca_rig.cli.main import run; run()"
    words = ["dynamic", "run", "--height", "215", "--speed", "2.433", "--repeats", "200"]
    running = subprocess.Popen([sys.executable, "-c", code, *words], stderr=subprocess.DEVNULL)
    folder = here / "runs" / "SIM-flapping-215-mm-2.433-rad-per-s-001"
    try:
        wait_for(lambda: len(list((folder / "stages").glob("*.h5"))) >= 2)
    finally:
        running.kill()
        running.wait()
    wait_for(lambda: is_over(folder))
    safe = sum(
        '"stage recorded"' in line for line in (folder / "events.jsonl").read_text().splitlines()
    )
    said = subprocess.run(
        [sys.executable, "-c", code, "recover", folder], capture_output=True, text=True, check=True
    ).stderr
    assert "SIM recovered" in said
    recording = read_recording(folder / "run.h5")
    assert [stroke.repeat for stroke in recording.strokes] == list(
        range(1, len(recording.strokes) + 1)
    )
    assert len(recording.strokes) >= max(safe, 2)
    assert all(raw.cut_short == "the control process ended" for raw in recording.raw)
    subprocess.run(
        [sys.executable, "-c", code, "check", folder], stdout=subprocess.DEVNULL, check=True
    )


def is_over(folder):
    try:
        check_not_running(folder)
    except BadInput:
        return False
    return True


def wait_for(condition):
    for _ in range(1000):
        if condition():
            return
        time.sleep(0.05)
    raise AssertionError("nothing came of it within 50 s")
