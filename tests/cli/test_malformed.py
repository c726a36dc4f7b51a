"""Devices, pipes, loops and files without end are one line and exit code 2; what the system refuses is no mistake of the program."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

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
        ((*DRY, "--protocol", "large.toml"), "large.toml: has 17 MB, where 16 MB are the most"),
        ((*DRY, "--height", "215", "--speed", "1e-7"), "speed_rad_s: should be greater than or equal to 0.01, not 1e-07"),
        ((*DRY, "--height", "215", "--speed", "1e7"), "speed_rad_s: should be less than or equal to 100"),
    ],
)
def test_a_file_without_end_or_a_speed_without_sense_is_one_line(here, monkeypatch, capsys, words, line):
    said = typed(monkeypatch, capsys, *words)
    assert said.exit_code == 2
    assert line in said.err
    assert said.err.count("\n") == 1


def test_a_loop_of_links_and_a_name_that_is_no_text_cost_the_list_of_runs_nothing(here, monkeypatch, capsys):
    Path("runs").mkdir()
    Path("runs/loop").symlink_to("loop")
    for name in (b"good", b"bad\xff"):
        folder = Path("runs", os.fsdecode(name))
        folder.mkdir()
        (folder / "run.json").write_text("{" * 5000)
    said = typed(monkeypatch, capsys, "runs")
    assert said.exit_code == 0
    assert "2 of 2 runs below runs" in said.out + said.err


@pytest.mark.parametrize(
    ("redirection", "code", "line"), [(">/dev/full", 1, "the system refused: No space left on device"), (">&-", 0, "")]
)
def test_output_that_has_nowhere_to_go_is_no_mistake_of_the_program(here, redirection, code, line):
    command = f'"{sys.executable}" -c "{RUN}" trip S-03 {redirection}'
    done = subprocess.run(["sh", "-c", command], capture_output=True, text=True, timeout=60, check=False)
    assert done.returncode == code
    assert line in done.stderr
    assert "mistake" not in done.stderr
    assert "Exception ignored" not in done.stderr
