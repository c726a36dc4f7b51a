"""rfca-rig prove as it is typed, stopped and continued."""

import csv
import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from rfca_rig.cli.commands import prove as prove_command
from rfca_rig.exam.cases import DEFAULT_NUMBERS
from tests.cli.typed import typed
from tests.exam_cases.examinees import wants_more_data

ROOT = Path(__file__).parents[2]
EXAM = ("--seed", 2, "--kind", "poor data", "--cases", 3)


def prove(monkeypatch, capsys, out, *words):
    return typed(monkeypatch, capsys, "prove", "--out", out, *words)


def started(out: Path) -> subprocess.Popen:
    """An exam in a process group of its own that has answered one case and hangs at the two
    others.
    """
    words = [
        sys.executable,
        "-m",
        "tests.exam_cases.examinees",
        "prove",
        "--out",
        str(out),
        *map(str, EXAM),
        "--workers",
        "3",
    ]
    process = subprocess.Popen(
        words, cwd=ROOT, stderr=subprocess.PIPE, text=True, start_new_session=True
    )
    until = time.monotonic() + 60.0
    while not ((out / "diagnoses" / "case-0001").is_dir() and len(hanging(out)) == 2):
        assert process.poll() is None and time.monotonic() < until
        time.sleep(0.05)
    return process


def hanging(out: Path) -> list[int]:
    return [
        int(path.read_text())
        for path in out.glob("diagnoses/.case-*.writing/pid")
        if path.read_text()
    ]


def alive(pid: int) -> bool:
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    return "\nState:\tZ" not in Path(f"/proc/{pid}/status").read_text()


def all_gone(pids: list[int]) -> bool:
    until = time.monotonic() + 10.0
    while any(map(alive, pids)):
        if time.monotonic() > until:
            return False
        time.sleep(0.05)
    return True


@pytest.mark.long
@pytest.mark.skipif(
    not Path("/proc/self/status").exists(), reason="asks Linux whether a process is alive"
)
@pytest.mark.parametrize(
    "how", [signal.SIGKILL, signal.SIGINT, signal.SIGTERM], ids=["kill", "^C", "SIGTERM"]
)
def test_a_stopped_exam_leaves_nobody_behind_and_goes_on_where_it_stood(
    monkeypatch, capsys, tmp_path, how
):
    out = tmp_path / "exam"
    process = started(out)
    workers = hanging(out)
    # A terminal sends ^C to the whole group, a batch queue SIGTERM to the command.
    if how == signal.SIGINT:
        os.killpg(process.pid, how)
    else:
        process.send_signal(how)
    _, said = process.communicate(timeout=120)
    if how != signal.SIGKILL:
        assert process.returncode == 130
        # Before it a log may have lines of progress, on a slow machine.
        *progress, end = said.splitlines()
        assert end == "rfca-rig: stopped by the operator; the same command goes on where it stood"
        assert all(line.endswith(" so far") for line in progress)
    assert all_gone(workers)
    kept = [
        *(out / "sealed").iterdir(),
        out / "seals.txt",
        *out.glob("campaigns/*/campaign.toml"),
        *out.glob("diagnoses/case-0001/*"),
    ]
    before = {path: path.stat().st_mtime_ns for path in kept}
    said = prove(monkeypatch, capsys, out, "--so-far")
    assert said.exit_code == 0 and "poor data: wrong effects" in said.out and "0 of 1" in said.out
    assert (
        "3 cases of the kind" in (out / "exam.html").read_text()
        and "1 of them so far" in (out / "exam.html").read_text()
    )
    monkeypatch.setattr(prove_command, "diagnose_as_typed", wants_more_data)
    said = prove(monkeypatch, capsys, out, *EXAM)
    assert said.exit_code == 0
    assert "poor data: wrong effects" in said.out and "0 of 3" in said.out
    assert {path: path.stat().st_mtime_ns for path in kept} == before
    assert sorted(folder.name for folder in (out / "diagnoses").iterdir()) == [
        "case-0001",
        "case-0002",
        "case-0003",
    ]


@pytest.mark.slow
def test_what_is_written_and_said(monkeypatch, capsys, tmp_path):
    monkeypatch.setattr(prove_command, "diagnose_as_typed", wants_more_data)
    said = prove(monkeypatch, capsys, tmp_path / "exam", *EXAM, "--workers", 1)
    assert said.exit_code == 0
    assert said.err.strip() == f"{tmp_path / 'exam' / 'exam.html'}: the whole result"
    assert "at most 0.05" in said.out and "passed" in said.out
    lines = list(
        csv.DictReader((tmp_path / "exam" / "exam.csv").read_text(encoding="utf-8").splitlines())
    )
    assert [line["verdict"] for line in lines] == ["not enough data"] * 3
    assert all(float(line["seconds"]) < 10.0 for line in lines)
    again = prove(monkeypatch, capsys, tmp_path / "exam", *EXAM, "--json")
    assert again.err == "" and json.loads(again.out)["seed"] == 2
    other = prove(monkeypatch, capsys, tmp_path / "exam", "--seed", 3)
    assert other.exit_code == 2 and len(other.err.splitlines()) == 1
    assert (
        "holds an exam with seed 2, 3 cases of the kind 'poor data', not seed 3, "
        f"{sum(DEFAULT_NUMBERS.values())} cases"
    ) in other.err


def test_a_folder_in_use_and_an_unknown_kind_are_refused(monkeypatch, capsys, tmp_path):
    (tmp_path / "mine.txt").write_text("mine")
    said = prove(monkeypatch, capsys, tmp_path)
    assert (said.exit_code, len(said.err.splitlines())) == (2, 1) and "is not empty" in said.err
    said = prove(monkeypatch, capsys, tmp_path / "new", "--kind", "odd")
    assert (said.exit_code, len(said.err.splitlines())) == (
        2,
        1,
    ) and "'odd' is unknown; there are 'nothing missing'" in said.err
    assert not (tmp_path / "new").exists()
    said = prove(monkeypatch, capsys, tmp_path / "new", "--so-far", "--take-out-each")
    assert (said.exit_code, len(said.err.splitlines())) == (
        2,
        1,
    ) and "--so-far only marks" in said.err
    said = prove(monkeypatch, capsys, tmp_path / "new", "--so-far")
    assert (said.exit_code, len(said.err.splitlines())) == (2, 1) and "plan.json" in said.err
    assert not (tmp_path / "new").exists()


@pytest.mark.long
@pytest.mark.timeout(1800)
def test_a_real_case_from_end_to_end(monkeypatch, capsys, tmp_path):
    said = prove(
        monkeypatch,
        capsys,
        tmp_path / "exam",
        "--seed",
        2,
        "--kind",
        "poor data",
        "--cases",
        1,
        "--workers",
        1,
    )
    assert said.exit_code == 0
    (answer,) = (tmp_path / "exam" / "diagnoses").iterdir()
    assert {"diagnosis.json", "diagnosis.html", "seconds.txt"} <= {
        file.name for file in answer.iterdir()
    }
    typed(
        monkeypatch,
        capsys,
        "diagnose",
        tmp_path / "exam" / "campaigns" / answer.name,
        "--out",
        tmp_path / "own",
    )
    assert (tmp_path / "own" / "diagnosis.json").read_text() == (
        answer / "diagnosis.json"
    ).read_text()
