"""`record`: devices without motion, from the command to what check, report, runs and export say of
it.
"""

import json
import os
import signal
import subprocess
import sys
from pathlib import Path

import can
import pytest

from rfca_rig.campaign.opening import open_recordings
from tests.cli.typed import typed, typed_in
from tests.waiting import wait_for

LISTENED = ("record", "--seconds", "0.5", "--pace", "0")


@pytest.fixture(scope="module")
def recorded(tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("record")
    said = typed_in(folder, *LISTENED, "--json")
    assert said.exit_code == 0, said.err
    answer = json.loads(said.out)
    assert answer["source"] == "SIM" and answer["ended"] == "done"
    # 0.5 s at 7000 Hz in datagrams of 40 records; the last one is not full and not sent.
    assert answer["samples"]["force"] == 3480
    return folder / answer["run"]


def test_the_recording_is_a_run_that_says_what_it_is(recorded, monkeypatch, capsys):
    assert recorded.name == "SIM-listening-001"
    (recording,) = open_recordings([recorded])
    assert recording.is_listening and recording.provenance["ended"] == "done"
    assert "0 lost, 0 twice" in recording.provenance["sensor_records"]
    (stage,) = recording.raw
    assert list(stage.streams) == ["shaft", "force", "can"] and not stage.cut_short
    monkeypatch.chdir(recorded.parents[1])
    checked = typed(monkeypatch, capsys, "check", recorded)
    assert checked.exit_code == 0
    assert "listening, recorded without motion" in checked.out
    listed = typed(monkeypatch, capsys, "runs", "--kind", "listening")
    assert "devices without motion" in listed.out


def test_report_says_that_nothing_moved(recorded, monkeypatch, capsys, tmp_path):
    said = typed(monkeypatch, capsys, "report", recorded, "--out", tmp_path / "out")
    assert said.exit_code == 0
    assert "recorded without motion: there is nothing to compare" in said.err
    assert "Recorded without motion" in (tmp_path / "out" / "report.html").read_text()
    page = (tmp_path / "out" / "run.html").read_text()
    assert "the motor was neither enabled nor commanded" in page
    assert "3480 received, 0 lost" in page.replace("\u202f", "").replace("\u00a0", " ")


@pytest.mark.parametrize("words", [("diagnose",), ("fit",), ("resume",)])
def test_what_needs_strokes_or_a_plan_says_why_it_refuses(recorded, monkeypatch, capsys, words):
    said = typed(monkeypatch, capsys, *words, recorded)
    assert said.exit_code == 2
    assert "without motion" in said.err or "is done" in said.err


@pytest.mark.parametrize("ending", ["asc", "blf", "log"])
def test_frames_are_exported_as_logs_that_python_can_reads(
    recorded, monkeypatch, capsys, tmp_path, ending
):
    out = tmp_path / f"bus.{ending}"
    said = typed(monkeypatch, capsys, "export", "can", recorded, "--out", out)
    assert said.exit_code == 0, said.err
    (stage,) = open_recordings([recorded])[0].raw
    frames = stage.streams["can"].columns
    with can.LogReader(out) as reader:
        messages = list(reader)
    assert [message.arbitration_id for message in messages] == frames["identifier"].data.tolist()
    # The twin's clock begins with the year 2000.
    if ending == "log":
        assert messages[0].timestamp == pytest.approx(946684800.0, abs=1.0)


def test_what_export_can_refuses_is_one_line(recorded, monkeypatch, capsys, tmp_path):
    other = typed(monkeypatch, capsys, "export", "can", recorded, "--out", tmp_path / "bus.pcap")
    assert other.exit_code == 2
    assert "should end with one of .asc, .blf, .log, .trc" in other.err
    # An imported campaign has no bus.
    folder = Path(__file__).parents[1] / "data" / "small-campaign"
    none = typed(monkeypatch, capsys, "export", "can", folder, "--out", tmp_path / "bus.log")
    assert none.exit_code == 2 and "holds no CAN frames" in none.err
    assert not (tmp_path / "bus.log").exists()


def test_a_recording_is_never_written_over(recorded, monkeypatch, capsys):
    said = typed(monkeypatch, capsys, *LISTENED, "--out", recorded)
    assert said.exit_code == 2 and "is there already" in said.err


def started(folder: Path) -> subprocess.Popen:
    """`record` without an end, in a process of its own, that has recorded something."""
    process = subprocess.Popen(
        [sys.executable, "-m", "rfca_rig", "record", "--out", "run"],
        cwd=folder,
        stderr=subprocess.PIPE,
        env={**os.environ, "PYTHONPATH": str(Path(__file__).parents[2])},
    )
    journal = folder / "run" / "stages" / "0001.journal"
    wait_for(lambda: journal.is_file() and journal.stat().st_size > 100_000)
    return process


@pytest.mark.slow
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_ends_it_and_the_recording_is_whole(tmp_path, monkeypatch, capsys, number):
    process = started(tmp_path)
    process.send_signal(number)
    assert process.wait(60) == 0
    assert typed(monkeypatch, capsys, "check", tmp_path / "run").exit_code == 0
    (recording,) = open_recordings([tmp_path / "run"])
    (stage,) = recording.raw
    assert not stage.cut_short
    numbers = stage.streams["force"].columns["rdt_sequence"].data
    assert len(numbers) > 500 and numbers.tolist() == list(range(1, len(numbers) + 1))


@pytest.mark.slow
def test_a_kill_leaves_what_was_recorded(tmp_path, monkeypatch, capsys):
    process = started(tmp_path)
    process.kill()
    process.wait(60)
    # The recorder has a process of its own, which ends when it has written everything.
    wait_for(lambda: typed(monkeypatch, capsys, "recover", tmp_path / "run").exit_code == 0)
    (recording,) = open_recordings([tmp_path / "run"])
    (stage,) = recording.raw
    assert stage.cut_short
    numbers = stage.streams["force"].columns["rdt_sequence"].data
    assert len(numbers) > 500 and numbers.tolist() == list(range(1, len(numbers) + 1))
