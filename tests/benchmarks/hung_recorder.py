"""Runs on the twin whose recorder hangs and then dies with the run: is every announced stroke in
what `recover` brings back?

    python -m tests.benchmarks.hung_recorder [--runs 32] [--seed SEED]

At a random moment the recorder is stopped (SIGSTOP), as by a disk that does not answer; half a
second to six seconds later recorder and run are killed (SIGKILL). A stroke counts as announced when
its line was printed. Exit code 1 where one is lost. Linux only.

A power cut is not the same: here the pages that the kernel has taken over survive.
"""

import argparse
import os
import random
import re
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections import Counter
from dataclasses import dataclass, field
from pathlib import Path

from rfca_rig.campaign.opening import open_recordings

RUN = ("dynamic", "run", "--height", "235", "--speed", "3.2", "--repeats", "40")
# Strokes after which the recorder hangs, and for how long it hangs before both are killed.
STROKES = (1, 11)
HANGS_S = (0.5, 6.0)
# A run that begins on a busy machine may take this long to its first stroke.
BEGINS_WITHIN_S = 120.0
PAUSE_S = 0.01


@dataclass
class Watched:
    """A run in a process of its own, and what it has printed so far."""

    process: subprocess.Popen[bytes]
    printed: bytearray = field(default_factory=bytearray)

    def read(self) -> None:
        assert self.process.stderr is not None
        try:
            while piece := os.read(self.process.stderr.fileno(), 1 << 16):
                self.printed += piece
        except BlockingIOError:
            return

    @property
    def announced(self) -> int:
        return len(re.findall(rb"repeat \d+: valley", self.printed))

    @property
    def is_over(self) -> bool:
        return self.process.poll() is not None

    def recorder(self) -> int | None:
        """Process id of its recorder."""
        for folder in Path("/proc").glob("[0-9]*"):
            try:
                parent = int((folder / "stat").read_text().rsplit(")", 1)[1].split()[1])
                if (
                    parent == self.process.pid
                    and b"recorder_process" in (folder / "cmdline").read_bytes()
                ):
                    return int(folder.name)
            # Ended meanwhile.
            except OSError:
                continue
        return None


def watch(runs: Path) -> Watched:
    words = [sys.executable, "-m", "rfca_rig", *RUN, "--runs", str(runs)]
    process = subprocess.Popen(
        words, stderr=subprocess.PIPE, stdout=subprocess.DEVNULL, start_new_session=True
    )
    assert process.stderr is not None
    os.set_blocking(process.stderr.fileno(), False)
    return Watched(process)


def hang_and_kill(run: Watched, chance: random.Random) -> bool:
    """Whether the run was killed while its recorder hung; a run that has ended before does not
    count.
    """
    wanted = chance.randint(*STROKES)
    until_s = time.monotonic() + BEGINS_WITHIN_S
    while run.announced < wanted and not run.is_over and time.monotonic() < until_s:
        run.read()
        time.sleep(PAUSE_S)
    # Anywhere within a stroke.
    time.sleep(chance.uniform(0.0, 0.1))
    hangs_s = chance.uniform(*HANGS_S)
    recorder = run.recorder()
    if recorder is not None and not run.is_over:
        os.kill(recorder, signal.SIGSTOP)
        until_s = time.monotonic() + hangs_s
        while time.monotonic() < until_s and not run.is_over:
            run.read()
            time.sleep(PAUSE_S)
    is_killed = recorder is not None and not run.is_over
    for process in (run.process.pid, recorder):
        if process is not None:
            try:
                os.kill(process, signal.SIGKILL)
            except ProcessLookupError:
                continue
    run.process.wait()
    run.read()
    return is_killed


def recovered_strokes(folder: Path) -> int:
    """The strokes of the run in what `recover` makes of it, 0 where it makes nothing."""
    done = subprocess.run(
        [sys.executable, "-m", "rfca_rig", "recover", str(folder)],
        capture_output=True,
        text=True,
        check=False,
    )
    if done.returncode:
        print(done.stderr.strip())
        return 0
    return len(open_recordings([folder])[0].strokes)


def main() -> None:
    """Kill the runs and print a line for each; exit code 1 where an announced stroke is lost."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--runs", type=int, default=32)
    parser.add_argument("--seed", type=int, default=1)
    asked = parser.parse_args()
    chance = random.Random(asked.seed)
    total = Counter[str]()
    print("  run  announced  recovered  lost  disk called silent")
    with tempfile.TemporaryDirectory() as name:
        for number in range(asked.runs):
            runs = Path(name, str(number))
            run = watch(runs)
            if not hang_and_kill(run, chance):
                total["ended before"] += 1
                print(f"{number:5d}  ended before it could be killed", flush=True)
                continue
            have = recovered_strokes(next(runs.iterdir()))
            lost = max(0, run.announced - have)
            total.update({"killed": 1, "announced": run.announced, "lost": lost})
            silent = "yes" if b"silent" in run.printed else "no"
            print(f"{number:5d}  {run.announced:9d}  {have:9d}  {lost:4d}  {silent}", flush=True)
            shutil.rmtree(runs)
    counts = (
        f"{total['killed']} runs killed, {total['announced']} strokes announced, "
        f"{total['lost']} lost"
    )
    print(f"{counts}, {total['ended before']} ended before, seed {asked.seed}")
    sys.exit(bool(total["lost"]))


if __name__ == "__main__":
    main()
