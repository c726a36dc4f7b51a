"""A stage of an hour: python -m tests.benchmarks.long_stage [--seconds 3600] [--folder DIR]

A journal as the recorder leaves it of a shaft at 500 Hz and a force sensor at 15 000 records/s is
made into a stage file, that into run.h5, and the run is checked, each in a process of its own.
Shown are bytes a second and the most memory that the process ever took, above what it took when it
began. The stage file is made twice, and its bytes compared.
"""

import argparse
import hashlib
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from rfca_rig.recording import run_folder
from rfca_rig.recording.atomic import AppendOnlyFile, remove
from rfca_rig.recording.checking import check_run
from rfca_rig.recording.columns import CommandedStart, Rows
from rfca_rig.recording.hdf5_file import run_to_completion
from rfca_rig.recording.journal import (
    Begin,
    End,
    JournalBlock,
    frame_block,
    samples_block,
    start_block,
)
from rfca_rig.recording.layout import journal_path, sha256_of, stage_path
from rfca_rig.recording.run_writer import RunWriter
from rfca_rig.recording.stage_file import write_stage
from tests.recording.growing import FORCE, FORMS, SHAFT, WRENCH, header

RATE_HZ = 15_000
TICKS_HZ = 500
KILOBYTE = 1024


def second(number: int, noise: np.ndarray) -> tuple[Rows, Rows]:
    """What the devices report within a second; force with the noise of a resting sensor, 0.2 N
    in counts of 1e-6 N.
    """
    shaft = np.zeros(TICKS_HZ, SHAFT.dtype)
    force = np.zeros(RATE_HZ, FORCE.dtype)
    for rows in (shaft, force):
        rows["device_s"] = number + np.arange(len(rows)) / len(rows)
        rows["host_s"] = rows["device_s"] + 100.0 + 1e-4 * noise[: len(rows), 0]
    shaft["shaft_angle_rad"] = np.sin(shaft["device_s"])
    for axis, name in enumerate(WRENCH):
        force[name] = 2e5 * noise[:, axis]
    return shaft, force


def blocks(seconds: int) -> Iterator[JournalBlock]:
    noise = np.random.default_rng(1).normal(size=(RATE_HZ, len(WRENCH)))
    yield Begin("an hour", 0.215, FORMS).block()
    yield start_block(CommandedStart(100.0))
    for number in range(seconds):
        shaft, force = second(number, np.roll(noise, 37 * number, axis=0))
        per_tick = RATE_HZ // TICKS_HZ
        for tick in range(TICKS_HZ):
            yield samples_block(
                (shaft[tick : tick + 1], force[tick * per_tick : (tick + 1) * per_tick])
            )
    yield End().block()


def make_journal(folder: Path, seconds: int) -> None:
    run_folder.create(folder, header())
    journal = AppendOnlyFile(journal_path(folder, 1))
    waiting: list[bytes] = []
    for block in blocks(seconds):
        waiting.append(frame_block(block))
        if len(waiting) >= TICKS_HZ:
            journal.append(b"".join(waiting))
            waiting = []
    journal.append(b"".join(waiting))
    journal.close()


def take_up(folder: Path) -> None:
    """As the recorder does with a stage that has ended, the events included."""
    writer = RunWriter(folder)
    writer._number = 2
    writer._ended = writer._ended.__class__([1])
    writer.work_off()
    writer.close("done")


def in_this_process(phase: str, folder: Path) -> None:
    """One phase, and what it took, on standard output."""
    began_MB = peak_MB()
    began_s = time.perf_counter()
    began_cpu_s = time.process_time()
    match phase:
        case "stage file":
            take_up(folder)
        case "run.h5":
            run_folder.build_recording(folder)
        case _:
            assert all(finding.is_sound for finding in check_run(folder))
    print(time.perf_counter() - began_s, time.process_time() - began_cpu_s, peak_MB(), began_MB)


def peak_MB() -> float:
    """The most memory that this process ever took, as Linux tells it."""
    lines = Path("/proc/self/status").read_text().splitlines()
    return float(next(line for line in lines if line.startswith("VmHWM")).split()[1]) / KILOBYTE


def measured(phase: str, folder: Path, size: int) -> str:
    words = [
        sys.executable,
        "-m",
        "tests.benchmarks.long_stage",
        "--phase",
        phase,
        "--folder",
        str(folder),
    ]
    said = subprocess.run(words, capture_output=True, text=True, check=True).stdout
    took_s, cpu_s, most_MB, began_MB = (float(word) for word in said.split())
    rate = f"{1e-6 * size / took_s:.0f} MB/s, {1e-6 * size / cpu_s:.0f} MB per s of processor"
    return (
        f"{phase:10s} {took_s:7.1f} s, {rate}; at most {most_MB:.0f} MB, "
        f"{most_MB - began_MB:.0f} MB above its start"
    )


def digest(path: Path) -> str:
    return hashlib.sha256(sha256_of(path).encode()).hexdigest()[:12]


def whole(folder: Path, seconds: int) -> None:
    began_s = time.perf_counter()
    make_journal(folder, seconds)
    journal = journal_path(folder, 1)
    stage = stage_path(folder, 1)
    size = journal.stat().st_size
    made_s = time.perf_counter() - began_s
    print(
        (
            f"{seconds} s, {seconds * RATE_HZ} records of force: journal of {1e-9 * size:.2f} "
            f"GB, made in {made_s:.0f} s"
        ),
        flush=True,
    )
    again = journal.with_name("0009.h5")
    if seconds <= 60:  # an hour needs the disk for other things
        run_to_completion(write_stage(journal, again, header()))
    print(measured("stage file", folder, size), flush=True)
    print(f"stage file of {1e-9 * stage.stat().st_size:.2f} GB, {digest(stage)}")
    if again.is_file():
        assert digest(again) == digest(stage), "the same bytes every time"
        remove(again)
    print(measured("run.h5", folder, stage.stat().st_size), flush=True)
    print(measured("check", folder, 2 * stage.stat().st_size), flush=True)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=int, default=60)
    parser.add_argument("--folder", type=Path, help="on the disk that is to be measured")
    parser.add_argument("--phase", help=argparse.SUPPRESS)
    words = parser.parse_args()
    if words.phase:
        in_this_process(words.phase, words.folder)
        return
    with tempfile.TemporaryDirectory(dir=words.folder) as place:
        whole(Path(place) / "run", words.seconds)


if __name__ == "__main__":
    main()
