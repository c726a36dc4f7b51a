"""rfca-rig resume as a person types it: what a run was killed in the middle of comes to its end,
and nothing goes on that should not.
"""

import json
import shutil
import subprocess
import sys
from contextlib import suppress
from pathlib import Path

import numpy as np
import pytest

from rfca_rig.bench import provenance
from rfca_rig.recording.atomic import AppendOnlyFile
from rfca_rig.recording.journal import BlockKind, parse_blocks
from rfca_rig.recording.layout import journals, stage_files
from rfca_rig.recording.run_text import events_of, lock
from rfca_rig.recording.store import read_recording
from rfca_rig.recording.tables import cycle_table
from tests.cli.test_commands import FILES, ROOT
from tests.cli.test_run_files import is_over, wait_for
from tests.cli.typed import typed, typed_in

CODE = "from rfca_rig.cli.main import run; run()"
CONDITION = ("--height", "215", "--speed", "3.249")


@pytest.fixture
def here(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.fixture(scope="module")
def of_two(tmp_path_factory):
    """A whole run of two strokes, made once."""
    folder = tmp_path_factory.mktemp("two")
    said = typed_in(
        folder,
        "dynamic",
        "run",
        *CONDITION,
        "--repeats",
        "2",
        "--rig",
        ROOT / "calibration" / "twin.toml",
    )
    assert said.exit_code == 0, said.err
    (run,) = (folder / "runs").iterdir()
    return run


@pytest.fixture
def stopped(of_two, here):
    """Makes a copy of the run as it is after one stroke, with the last words that `why` says,
    with a rig file beside it.
    """

    def make(why):
        run = here / "run"
        shutil.copytree(of_two, run)
        for name in ("run.h5", "end.json", "SHA256SUMS", "stages/0002.h5"):
            (run / name).unlink()
        lines = (run / "events.jsonl").read_text().splitlines(keepends=True)
        second = [number for number, line in enumerate(lines) if "stage begins" in line][1]
        if why:
            last = [json.dumps({"event": "run ends", "why": why}) + "\n"]
            (run / "end.json").write_text(
                json.dumps({"provenance": {"ended": why, "lasted_s": "3.5"}, "static": None})
            )
        else:
            last = []
        (run / "events.jsonl").write_text("".join([*lines[:second], *last]))
        header = json.loads((run / "run.json").read_text())
        header["provenance"]["rig"] = "rig.toml"
        (run / "run.json").write_text(json.dumps(header))
        shutil.copy(ROOT / "calibration" / "twin.toml", here / "rig.toml")
        shutil.copy(ROOT / "calibration" / "twin-camera.toml", here)
        return run

    return make


def killed(here, words, when):
    """Starts the command, kills it without warning once `when(folder)` is so; the run's folder."""
    running = subprocess.Popen(
        [sys.executable, "-c", CODE, *map(str, words)], stderr=subprocess.DEVNULL
    )
    try:
        wait_for(lambda: any((here / "runs").glob("*/run.json")))
        (folder,) = (here / "runs").iterdir()
        wait_for(lambda: when(folder))
    finally:
        running.kill()
        running.wait()
    wait_for(lambda: is_over(folder))
    return folder


@pytest.mark.slow
@pytest.mark.skipif(sys.platform == "win32", reason="no signal that cannot be caught")
def test_a_run_killed_without_warning_goes_on_to_its_end(here, monkeypatch, capsys):
    folder = killed(
        here,
        ["dynamic", "run", *CONDITION, "--repeats", 4],
        lambda folder: len(stage_files(folder)) >= 1,
    )
    said = typed(monkeypatch, capsys, "resume", folder)
    assert said.exit_code == 0
    assert "SIM 4 strokes and 0 static stages" in said.err.splitlines()[-1]
    found = read_recording(folder / "run.h5")
    assert [stroke.repeat for stroke in found.strokes] == [1, 2, 3, 4]
    assert found.provenance["ended"] == "done"
    (resumed,) = json.loads(found.provenance["resumed"])
    assert resumed["stopped"] == "the control process ended"
    assert (
        resumed["done"]["strokes"]
        == json.loads(found.provenance["resumed"])[0]["done"]["strokes"]
        >= 1
    )
    assert {"t_s", "utc", "seed"} <= set(resumed) and set(resumed["stopped_at"]) == {"t_s", "utc"}
    assert (resumed["seed"], found.provenance["seed"]) != (1, "1")
    assert sorted(file.name for file in folder.iterdir()) == FILES
    assert typed(monkeypatch, capsys, "check", folder).exit_code == 0
    assert typed(monkeypatch, capsys, "report", folder, "--out", "report").exit_code == 0
    again = typed(monkeypatch, capsys, "resume", folder)
    assert (again.exit_code, len(again.err.splitlines())) == (2, 1)
    assert "is done; there is nothing left to resume" in again.err


def rows(folder):
    """Cycles in the journal of the stage in progress; it may be gone by the time it is looked
    at.
    """
    for journal in journals(folder)[-1:]:
        with suppress(FileNotFoundError):
            return sum(
                block.kind is BlockKind.SAMPLES for block in parse_blocks(journal.read_bytes())[0]
            )
    return 0


FEW = (
    ("every = 10_000", "every = 12"),
    ("[75.0, 100.0, 125.0]", "[100.0]"),
    ("for_s = 0.3", "for_s = 0.1"),
)


@pytest.mark.slow
@pytest.mark.skipif(sys.platform == "win32", reason="no signal that cannot be caught")
def test_a_cycle_is_never_counted_twice_nor_left_out_though_the_run_is_killed_among_them(
    here, monkeypatch, capsys
):
    text = (ROOT / "protocols" / "fatigue.toml").read_text()
    for old, new in FEW:
        text = text.replace(old, new)
    (here / "few.toml").write_text(text)

    def is_counting(folder):
        return 2 <= rows(folder) < 12 and "cycles 2 to 12" in (folder / "events.jsonl").read_text()

    folder = killed(here, ["fatigue", "run", "--protocol", "few.toml", "--cycles", 12], is_counting)
    said = typed(monkeypatch, capsys, "resume", folder)
    assert said.exit_code == 0
    found = read_recording(folder / "run.h5")
    assert cycle_table(found).numbers.tolist() == list(range(2, 13))
    (part, rest) = [stage for stage in found.raw if "cycles" in stage.streams]
    assert (part.cut_short, rest.cut_short) == ("the control process ended", "")
    assert [stroke.repeat for stroke in found.strokes] == [1]
    assert [stage.stage for stage in found.static] == [1, 2]
    assert "12 of 12 cycles done" in said.err.splitlines()[-1]
    assert "stiffness drift " in said.err.splitlines()[-1]
    assert typed(monkeypatch, capsys, "check", folder).exit_code == 0


@pytest.mark.slow
def test_what_a_limit_stopped_goes_on_only_when_told_so(stopped, monkeypatch, capsys):
    run = stopped("TRIP F-02: following error")
    said = typed(monkeypatch, capsys, "resume", run)
    assert (said.exit_code, len(said.err.splitlines())) == (2, 1)
    assert (
        "was stopped by TRIP F-02: following error; look at the rig, then say --after-trip"
        in said.err
    )
    said = typed(monkeypatch, capsys, "resume", run, "--after-trip", "--dry-run")
    assert said.exit_code == 0
    assert "flapping 215 mm 3.249 rad per s, 1 strokes" in said.err


@pytest.mark.slow
def test_a_dry_run_leaves_the_run_as_it_is(stopped, monkeypatch, capsys):
    run = stopped("")
    before = {
        file: file.read_bytes()
        for file in run.rglob("*")
        if file.is_file() and file.name != ".ballast"
    }
    assert typed(monkeypatch, capsys, "resume", run, "--dry-run").exit_code == 0
    assert {file: file.read_bytes() for file in run.rglob("*") if file.is_file()} == before


@pytest.mark.slow
def test_another_rig_is_refused_by_the_names_of_its_keys_unless_it_is_meant(
    stopped, here, monkeypatch, capsys
):
    run = stopped("")
    rig = (here / "rig.toml").read_text()
    (here / "rig.toml").write_text(
        rig.replace("force_N = 300.0", "force_N = 200.0").replace("node_id = 0", "node_id = 3")
    )
    said = typed(monkeypatch, capsys, "resume", run)
    assert said.exit_code == 2
    assert (
        "rig.toml: limits.force_N is 200.0 and was 300.0, motor.node_id is 3 and was 0; to go on "
        "with it, say --rig"
    ) in said.err
    said = typed(monkeypatch, capsys, "resume", run, "--rig", here / "rig.toml", "--dry-run")
    assert said.exit_code == 0
    assert "limits 200 N" in said.err
    (here / "rig.toml").write_text(
        rig.replace("friction_coefficient = 0.41", "friction_coefficient = 0.42")
    )
    said = typed(monkeypatch, capsys, "resume", run, "--rig", here / "rig.toml")
    assert (
        "ground.friction_coefficient is 0.42 and was 0.41; one run has one nominal model"
        in said.err
    )
    (here / "rig.toml").write_text(rig + "# only a word more\n")
    assert typed(monkeypatch, capsys, "resume", run, "--dry-run").exit_code == 0


def change_header(run, **facts):
    header = json.loads((run / "run.json").read_text())
    header["provenance"] |= facts
    (run / "run.json").write_text(json.dumps(header))


@pytest.mark.slow
def test_another_sensor_is_refused_before_anything_moves_unless_it_is_meant(
    stopped, here, monkeypatch, capsys
):
    run = stopped("")
    now = json.loads((run / "run.json").read_text())["provenance"]
    change_header(
        run,
        sensor_counts_per_N="500000.0",
        motor_bus="another",
        rfca_rig_version="0.0.1",
        motor_encoder_frames_lost="7",
    )
    before = (run / "events.jsonl").read_bytes()

    def never(*_words):
        raise AssertionError("nothing may run")

    with monkeypatch.context() as patched:
        patched.setattr("rfca_rig.cli.run_experiment.run_plan", never)
        said = typed(monkeypatch, capsys, "resume", run)
    counts = now["sensor_counts_per_N"]
    assert said.exit_code == 2
    assert said.err.splitlines()[-1].endswith(
        f"run: sensor_counts_per_N is {counts} and was 500000.0; to go on with this "
        "device, say --rig rig.toml"
    )
    assert (run / "events.jsonl").read_bytes() == before
    said = typed(monkeypatch, capsys, "resume", run, "--rig", here / "rig.toml")
    assert said.exit_code == 0
    (resumed,) = [event for event in events_of(run) if event["event"] == "run resumed"]
    assert resumed["rig_changes"] == {"sensor_counts_per_N": counts}
    assert resumed["noted"] == {
        "motor_bus": {"before": "another", "now": now["motor_bus"]},
        "rfca_rig_version": {"before": "0.0.1", "now": now["rfca_rig_version"]},
    }
    assert typed(monkeypatch, capsys, "check", run).exit_code == 0
    assert typed(monkeypatch, capsys, "report", run, "--out", "report").exit_code == 0
    page = (here / "report" / "run.html").read_text()
    assert f"sensor_counts_per_N {counts}" in page and "rfca rig version" in page


@pytest.mark.slow
def test_a_drive_that_tells_its_number_only_once_it_is_armed_is_compared_then(
    stopped, monkeypatch, capsys
):
    run = stopped("")
    change_header(run, motor_serial_number="1111")
    before = {file: file.read_bytes() for file in run.rglob("*") if file.is_file()}
    told = iter(("unknown", "2222"))
    of_devices = provenance.devices

    def devices(bench):
        return {**of_devices(bench), "motor_serial_number": next(told)}

    monkeypatch.setattr(provenance, "devices", devices)
    said = typed(monkeypatch, capsys, "resume", run)
    assert said.exit_code == 2
    assert "motor_serial_number is 2222 and was 1111; to go on with this device" in said.err
    assert next(told, None) is None
    assert {file: file.read_bytes() for file in run.rglob("*") if file.is_file()} == before


@pytest.mark.slow
def test_a_run_that_still_goes_on_is_left_alone(stopped, monkeypatch, capsys):
    run = stopped("")
    events = AppendOnlyFile(run / "events.jsonl")
    lock(events)
    said = typed(monkeypatch, capsys, "resume", run)
    events.close()
    assert said.exit_code == 2
    assert "the run is still going on" in said.err


@pytest.mark.slow
def test_a_folder_without_a_run_and_a_run_with_everything_in_it_are_told_so(
    of_two, here, monkeypatch, capsys
):
    assert "holds no run that could go on" in typed(monkeypatch, capsys, "resume", here).err
    shutil.copytree(of_two, here / "run")
    events = [
        line
        for line in (here / "run" / "events.jsonl").read_text().splitlines(keepends=True)
        if '"why"' not in line
    ]
    (here / "run" / "events.jsonl").write_text("".join(events))
    said = typed(
        monkeypatch, capsys, "resume", here / "run", "--rig", ROOT / "calibration" / "twin.toml"
    )
    assert "every stage is recorded; to bring it to its end, type rfca-rig recover" in said.err


@pytest.mark.slow
def test_stage_files_that_are_not_those_of_the_plan_are_refused(stopped, monkeypatch, capsys):
    run = stopped("")
    header = json.loads((run / "run.json").read_text())
    header["provenance"]["plan"] = header["provenance"]["plan"].replace(
        '"repeat": 1', '"repeat": 7'
    )
    (run / "run.json").write_text(json.dumps(header))
    assert (
        "its stage files are not what its plan begins with"
        in typed(monkeypatch, capsys, "resume", run).err
    )


@pytest.mark.slow
def test_events_tell_both_clocks_of_every_part(stopped, monkeypatch, capsys):
    run = stopped("stopped by the operator")
    assert typed(monkeypatch, capsys, "resume", run, "--operator", "Ada").exit_code == 0
    (resumed,) = [event for event in events_of(run) if event["event"] == "run resumed"]
    assert (resumed["stopped"], resumed["operator"]) == ("stopped by the operator", "Ada")
    assert resumed["stopped_at"]["t_s"] > 0.0
    assert resumed["ending"] == {"ended": "stopped by the operator", "lasted_s": "3.5"}
    assert resumed["seed"] == np.random.SeedSequence([1, 1]).generate_state(1)[0]
    found = read_recording(run / "run.h5")
    assert [stroke.repeat for stroke in found.strokes] == [1, 2]
    first, second = (stroke.streams["force"].columns["fz_N"].data for stroke in found.strokes)
    assert not np.array_equal(first[:500], second[:500])
    assert typed(monkeypatch, capsys, "check", run).exit_code == 0


@pytest.mark.slow
def test_a_part_that_records_nothing_leaves_the_run_with_what_it_had(stopped, monkeypatch, capsys):
    """Unlike a run that never recorded anything, which leaves nothing behind."""
    run = stopped("stopped by the operator")

    def stopped_at_once(*_words):
        from rfca_rig.errors import Stopped

        there = {file.name for file in run.iterdir()}
        assert (
            not {"end.json", "run.h5", "SHA256SUMS"} & there
        )  # a crash now leaves no run that has ended
        assert ".ballast" in there
        raise Stopped("not now")

    with monkeypatch.context() as patched:
        patched.setattr("rfca_rig.cli.run_experiment.run_plan", stopped_at_once)
        assert typed(monkeypatch, capsys, "resume", run).exit_code == 130
    assert len(read_recording(run / "run.h5").strokes) == 1
    assert Path(run / "end.json").is_file()
    assert typed(monkeypatch, capsys, "resume", run).exit_code == 0
    found = read_recording(run / "run.h5")
    assert [stroke.repeat for stroke in found.strokes] == [1, 2]
    first, second = json.loads(found.provenance["resumed"])
    assert (first["stopped"], second["stopped"]) == ("stopped by the operator", "not now")
    assert first["seed"] != second["seed"]


@pytest.mark.slow
def test_a_static_run_goes_on_with_its_photos_numbered_on_and_all_of_them_read(
    here, monkeypatch, capsys
):
    head = (
        (ROOT / "protocols" / "static-angle.toml")
        .read_text()
        .partition("[[stages]]")[0]
        .replace("[215.0, 235.0]", "[235.0]")
    )
    head = head.replace("move_speed_rad_s = 0.4", "move_speed_rad_s = 1.6")
    (here / "stages.toml").write_text(
        head + "".join(f"[[stages]]\nangle_deg = {angle}\n" for angle in (60.0, 75.0))
    )
    assert typed(monkeypatch, capsys, "static", "run", "--protocol", "stages.toml").exit_code == 0
    (run,) = (here / "runs").iterdir()
    whole = read_recording(run / "run.h5")
    for name in (
        "run.h5",
        "end.json",
        "SHA256SUMS",
        "stages/0002.h5",
        "photos/002.png",
        "overlays/002.jpg",
        "overlays/001.jpg",
    ):
        (run / name).unlink()
    lines = (run / "events.jsonl").read_text().splitlines(keepends=True)
    recorded = next(number for number, line in enumerate(lines) if "stage recorded" in line)
    (run / "events.jsonl").write_text("".join(lines[: recorded + 1]))
    first_photo = (run / "photos" / "001.png").read_bytes()
    said = typed(monkeypatch, capsys, "resume", run)
    assert said.exit_code == 0
    found = read_recording(run / "run.h5")
    assert [stage.photo for stage in found.static] == ["photos/001.png", "photos/002.png"]
    assert (run / "photos" / "001.png").read_bytes() == first_photo
    # All photos are fitted together, and the second was taken again.
    assert found.static[0].hinge_deg == pytest.approx(whole.static[0].hinge_deg, abs=0.05)
    assert found.static[1].hinge_deg == pytest.approx(whole.static[1].hinge_deg, abs=0.5)
    assert found.static[1].fz_N == pytest.approx(whole.static[1].fz_N, rel=0.05)
    assert "overlays/001.jpg" in found.provenance["photos_sha256"]
    assert typed(monkeypatch, capsys, "check", run).exit_code == 0
