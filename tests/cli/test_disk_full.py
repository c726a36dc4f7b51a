"""A disk that another program fills, on a file system of its own: what the user sees, and what
is left.
"""

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from rfca_rig.recording.store import read_recording
from tests.cli.test_run_files import wait_for

CODE = "from rfca_rig.cli.main import run; run()"
WORDS = ["dynamic", "run", "--height", "215", "--speed", "2.433", "--repeats", "40"]
SEGMENTATION_FAULT = (139, -11)


@pytest.fixture
def small_disk(tmp_path: Path):
    """Where this system lets one mount it."""
    place = tmp_path / "disk"
    place.mkdir()
    try:
        done = subprocess.run(
            ["mount", "-t", "tmpfs", "-o", "size=256m", "none", str(place)],
            capture_output=True,
            check=False,
        )
    except OSError:
        pytest.skip("no mount here")
    if done.returncode:
        pytest.skip("may not mount here")
    yield place
    subprocess.run(["umount", str(place)], check=True)


def fill(place: Path) -> None:
    """The run writes at the same time, so half of what is free is taken at once, and then half
    of the rest.
    """
    with (
        (place / "others").open("wb", buffering=0) as others,
        pytest.raises(OSError, match="No space left"),
    ):
        while (free := shutil.disk_usage(place).free) > 256 << 10:
            os.posix_fallocate(others.fileno(), others.seek(0, os.SEEK_END), free // 2)
        others.seek(0, os.SEEK_END)
        while True:
            others.write(bytes(4096))


@pytest.mark.long
@pytest.mark.skipif(sys.platform != "linux", reason="a file system in memory is mounted")
def test_on_a_full_disk_the_motor_is_off_first_and_every_acknowledged_stage_is_there(
    small_disk: Path, tmp_path: Path
):
    running = subprocess.Popen(
        [sys.executable, "-c", CODE, *WORDS, "--runs", small_disk],
        cwd=tmp_path,
        stderr=subprocess.PIPE,
        text=True,
        encoding="utf-8",
    )
    folder = small_disk / "SIM-flapping-215-mm-2.433-rad-per-s-001"
    wait_for(lambda: len(list((folder / "stages").glob("*.h5"))) >= 2)
    fill(small_disk)
    said = running.communicate(timeout=100)[1].splitlines()
    assert running.returncode == 1
    assert running.returncode not in SEGMENTATION_FAULT
    assert said[-1].startswith("rfca-rig: stopped: disk full: ")
    assert not any("Traceback" in line for line in said)
    events = [json.loads(line) for line in (folder / "events.jsonl").read_text().splitlines()]
    acknowledged = [event["file"] for event in events if event["event"] == "stage recorded"]
    assert len(acknowledged) >= 2
    for file in acknowledged:
        assert len(read_recording(folder / file).strokes) == 1
    (off,) = [event for event in events if event["event"] == "motor off"]
    assert events.index(off) < [event["event"] for event in events].index("run ends")
    (small_disk / "others").unlink()
    if not (folder / "SHA256SUMS").is_file():
        subprocess.run(
            [sys.executable, "-c", CODE, "recover", folder],
            cwd=tmp_path,
            check=True,
            capture_output=True,
        )
    found = read_recording(folder / "run.h5")
    assert len(found.strokes) == len(acknowledged)
    subprocess.run(
        [sys.executable, "-c", CODE, "check", folder], cwd=tmp_path, check=True, capture_output=True
    )
