"""Devices, pipes, loops and files without end are one line and exit code 2; what the system
refuses is no mistake of the program.
"""

import json
import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

from rfca_rig.errors import BadInput
from rfca_rig.executors.cores import cores
from rfca_rig.recording.atomic import write_atomically
from tests.cli.malformed_inputs import Recordings, find_violations, make_cases
from tests.cli.typed import typed

RUN = "from rfca_rig.cli.main import run; run()"
DRY = ("dynamic", "run", "--dry-run")

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="devices and pipes of Unix")


@pytest.fixture
def here(tmp_path: Path, monkeypatch) -> Path:
    monkeypatch.chdir(tmp_path)
    os.mkfifo("pipe.toml")
    Path("deep.toml").write_text("a = " + "[" * 20_000 + "]" * 20_000)
    with Path("large.toml").open("wb") as file:
        file.truncate(17_000_000)
    return tmp_path


@pytest.mark.parametrize(
    ("words", "line"),
    [
        ((*DRY, "--protocol", "/dev/zero"), "/dev/zero: is a device or a pipe; give a file"),
        ((*DRY, "--protocol", "./pipe.toml"), "pipe.toml: is a device or a pipe; give a file"),
        ((*DRY, "--rig", "/dev/zero"), "/dev/zero: is a device or a pipe; give a file"),
        ((*DRY, "--protocol", "deep.toml"), "deep.toml: is nested too deeply"),
        ((*DRY, "--protocol", "large.toml"), "large.toml: has 17 MB, where 4 MB are the most"),
        (
            (*DRY, "--height", "215", "--speed", "1e-7"),
            "speed_rad_s: should be greater than or equal to 0.01, not 1e-07",
        ),
        (
            (*DRY, "--height", "215", "--speed", "1e7"),
            "speed_rad_s: should be less than or equal to 100",
        ),
    ],
)
def test_a_file_without_end_or_a_speed_without_sense_is_one_line(
    here, monkeypatch, capsys, words, line
):
    said = typed(monkeypatch, capsys, *words)
    assert said.exit_code == 2
    assert line in said.err
    assert said.err.count("\n") == 1


@pytest.mark.parametrize("form", [(), ("--paths",), ("--json",)])
def test_loops_and_names_that_are_no_text_or_commands_cost_the_list_of_runs_nothing(
    here, monkeypatch, capsys, form
):
    Path("runs").mkdir()
    Path("runs/loop").symlink_to("loop")
    Path("runs/up").symlink_to("..")
    for name in (
        b"good",
        b"bad\xff",
        b"\x1b]0;owned\x07",
        b"two\nlines",
        b"\xc2\x9b31m",
        b"n" * 255,
    ):
        folder = Path("runs", os.fsdecode(name))
        folder.mkdir()
        (folder / "run.json").write_text("{" * 5000)
    # As on a terminal: a program that reads the paths gets them as they are.
    monkeypatch.setattr(sys.stdout, "isatty", lambda: True)
    said = typed(monkeypatch, capsys, "runs", *form)
    assert said.exit_code == 0
    assert not set("\x1b\x07\x9b") & set(said.out + said.err)
    if form == ("--json",):
        assert len(json.loads(said.out)["runs"]) == 6
    elif form:
        assert len(said.out.splitlines()) == 6
    else:
        assert "6 of 6 runs below runs" in said.err


# Each takes some tens of milliseconds; `python -m tests.benchmarks.malformed` runs as many as one
# likes.
def test_malformed_inputs_are_one_line_or_a_normal_result(tmp_path):
    recordings = Recordings(tmp_path)
    found = []
    for number, case in enumerate(make_cases(1000, 150, recordings)):
        folder = tmp_path / f"{number}"
        folder.mkdir()
        found += [
            f"{number} {case.label}: {violation}" for violation in find_violations(case, folder)
        ]
    assert not found


def test_a_long_value_does_not_hide_what_is_said_of_it(here, monkeypatch, capsys):
    Path("long.toml").write_text(f"experiment = '{'x' * 200_000}'\n")
    said = typed(monkeypatch, capsys, *DRY, "--protocol", "long.toml")
    assert said.exit_code == 2
    assert len(said.err) < 1000
    assert "long.toml:1: experiment: should be 'dynamic', not 'xxx" in said.err


def test_a_path_below_a_link_to_itself_is_one_line(here, monkeypatch, capsys):
    Path("loop").symlink_to("loop")
    said = typed(monkeypatch, capsys, "import", "loop/below")
    assert said.exit_code == 2
    assert "loop/below: Too many levels of symbolic links; give another path" in said.err
    assert said.err.count("\n") == 1


@pytest.mark.parametrize("target", ["pipe.toml", "link"])
def test_an_output_that_is_a_device_or_a_pipe_is_never_replaced(here, monkeypatch, capsys, target):
    """An administrator's --csv /dev/null would put a file in the place of the device, for the
    whole machine.
    """
    Path("link").symlink_to("pipe.toml")
    before = Path(target).lstat().st_ino
    said = typed(monkeypatch, capsys, "predict", "--height", "215", "--speed", "2", "--csv", target)
    assert said.exit_code == 2
    assert f"{target}: is a device or a pipe, where a file is needed" in said.err
    with pytest.raises(BadInput, match="is a device or a pipe"):
        write_atomically(Path(target), b"")
    assert Path(target).lstat().st_ino == before


@pytest.mark.parametrize("setting", ["0", "-1", "many", "1000000000", "٣", "1.5"])
def test_a_number_of_threads_that_is_none_is_refused(monkeypatch, setting):
    monkeypatch.setenv("RFCA_RIG_THREADS", setting)
    with pytest.raises(
        BadInput,
        match=(
            f"RFCA_RIG_THREADS={re.escape(setting)}: should be a number of threads from 1 to 1024"
        ),
    ):
        cores()


@pytest.mark.parametrize(
    ("redirection", "code", "line"),
    [(">/dev/full", 1, "the system refused: No space left on device"), (">&-", 0, "")],
)
def test_output_that_has_nowhere_to_go_is_no_mistake_of_the_program(here, redirection, code, line):
    command = f'"{sys.executable}" -c "{RUN}" trip S-03 {redirection}'
    done = subprocess.run(
        ["sh", "-c", command], capture_output=True, text=True, timeout=60, check=False
    )
    assert done.returncode == code
    assert line in done.stderr
    assert "mistake" not in done.stderr
    assert "Exception ignored" not in done.stderr
