"""Flapping without end, in real time, over real sockets.

Run: python -m tests.benchmarks.soak [--seconds 3600] [--rate 15000] [--lenient]

The twin server in a process of its own is the rig: force records by UDP, the drive as socketcand.
This process runs the engine at 500 Hz with the recorder process behind it, one plan after the other
until the time is up. Above the 7912 records/s that the box can be set to, a sender in a third
process is the force sensor; its counts are numbers and no forces, so that load is not watched.
Shown every minute, and in the end: memory of this process and of the recorder, records lost by the
sensor's own numbers, the longest gap of the loop, and what tripped. A trip ends its plan and the
next one begins; with --runs what was recorded stays there, and another soak goes on behind it.
"""

import argparse
import builtins
import json
import logging
import os
import re
import tempfile
import time
from collections.abc import Iterator
from contextlib import ExitStack, closing, contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from rfca_rig.acquisition.acquired import AcquiredDatagrams
from rfca_rig.bench.factory import open_bench
from rfca_rig.bench.recorder import Recorder
from rfca_rig.clock import Clock
from rfca_rig.description.rig_file import RigFile
from rfca_rig.devices.netft.driver import NetFtSensor, record_source
from rfca_rig.devices.netft.section import NetFtSettings
from rfca_rig.engine.run import run_plan
from rfca_rig.errors import RigError
from rfca_rig.protocol.plan import Flap, Plan
from rfca_rig.recording import run_folder
from rfca_rig.recording.backend import RecorderClient
from rfca_rig.recording.checking import check_run
from rfca_rig.recording.model import Recording
from tests.acquisition.sender import sending
from tests.engine.rigs import ROOT, one_condition
from tests.twin_server.server import Server, serving
from tests.twin_server.test_real_run import real_rig

REPEATS = 400
BOX_RATE_HZ = 7912.0
REPORT_EVERY_S = 60.0
KILOBYTE = 1024


def memory_MB(process_id: int | str) -> float:
    """What is resident of a process on Linux."""
    lines = Path(f"/proc/{process_id}/status").read_text().splitlines()
    return float(next(line for line in lines if line.startswith("VmRSS")).split()[1]) / KILOBYTE


class TimeIsUp(Exception):
    """Ends a plan from within its progress."""


@dataclass
class Watched:
    """What a soak has seen so far. `memory` holds seconds, MB of this process, MB of the
    recorder.
    """

    until_s: float
    strokes: int = 0
    lost: int = 0
    received: int = 0
    worst_gap_s: float = 0.0
    trips: list[str] = field(default_factory=list)
    memory: list[tuple[float, float, float]] = field(default_factory=list)

    def look(self, recorder_id: int) -> None:
        self.memory.append((time.monotonic(), memory_MB("self"), memory_MB(recorder_id)))

    def text(self) -> str:
        if not self.memory:
            return f"no stage done, {len(self.trips)} trips {sorted(set(self.trips))}"
        seconds, ours, its = np.array(self.memory).T
        seconds = seconds - seconds[0]
        later = seconds >= min(60.0, 0.2 * seconds[-1])  # caches fill first
        slopes = [
            3600.0 * np.polyfit(seconds[later], memory[later], 1)[0] if later.sum() > 2 else np.nan
            for memory in (ours, its)
        ]
        memory = ", ".join(
            f"{name} {memory[0]:.0f} -> {memory[-1]:.0f} MB ({slope:+.1f} MB/h)"
            for name, memory, slope in zip(("loop", "recorder"), (ours, its), slopes, strict=True)
        )
        if self.trips:
            trips = f"{len(self.trips)} trips {sorted(set(self.trips))}"
        else:
            trips = "no trip"
        return (
            f"{seconds[-1]:6.0f} s, {self.strokes} strokes, {self.received} records, "
            f"{self.lost} lost, "
            f"worst gap {1e3 * self.worst_gap_s:.1f} ms, {trips}; {memory}"
        )


def plan_of(rig: RigFile, lenient: bool, rate_Hz: float) -> Plan:
    plan = one_condition(rig, REPEATS, 2.433)
    limits = plan.limits
    if lenient:
        limits = replace(
            limits,
            sensor_silent_s=5.0,
            drive_silent_s=5.0,
            reading_age_s=5.0,
            late_s=5.0,
            following_error_rad=10.0,
        )
    if rate_Hz > BOX_RATE_HZ:
        limits = replace(limits, force_N=1e9, torque_Nm=1e9, above_expected=1e9)
    return replace(plan, limits=limits)


@contextmanager
def fast_sensor(clock: Clock, rate_Hz: float) -> Iterator[NetFtSensor]:
    """Forty records to a datagram, as the box sends them at such rates."""
    with (
        sending(rate_Hz, 40, 1e6) as (port, _),
        closing(AcquiredDatagrams(record_source("127.0.0.1", port), clock)) as datagrams,
    ):
        yield NetFtSensor(
            datagrams, clock, NetFtSettings(rate_Hz=rate_Hz, internal_rate_Hz=rate_Hz)
        )


def one_run(rig: RigFile, folder: Path, seen: Watched, lenient: bool, rate_Hz: float) -> None:
    """One plan, or as much of it as there is time for."""
    with open_bench(rig, None) as opened, ExitStack() as things:
        if rate_Hz <= BOX_RATE_HZ:
            bench = opened
        else:
            bench = replace(opened, sensor=things.enter_context(fast_sensor(opened.clock, rate_Hz)))
        run_folder.create(folder, Recording("soak", "REAL", rig.nominal(), {}, (), ()))
        keeper = RecorderClient(folder, patient=False)
        recorder = Recorder(keeper, bench.sensor.scale(), bench.clock)
        reported_s = time.monotonic()

        def progress(stage: object) -> None:
            nonlocal reported_s
            seen.strokes += isinstance(stage, Flap)
            seen.look(keeper.process_id)
            if time.monotonic() - reported_s > REPORT_EVERY_S:
                reported_s = time.monotonic()
                print(seen.text(), flush=True)
            if time.monotonic() > seen.until_s:
                raise TimeIsUp

        why = "done"
        try:
            run_plan(plan_of(rig, lenient, rate_Hz), bench, recorder, progress)
        except TimeIsUp:
            why = "time is up"
        except RigError as error:
            why = str(error)
            seen.trips.append(why[:60])
        finally:
            keeper.finish(why)
        health = bench.sensor.health()
        seen.lost += health.lost
        seen.received += health.received
        seen.worst_gap_s = max(seen.worst_gap_s, recorder.worst_gap_s)


def at_rate(folder: Path, rate_Hz: float) -> Path:
    """The twin's rig file with another rate of records."""
    text, found = re.subn(
        r"(?m)^rate_Hz = .*$",
        f"rate_Hz = {rate_Hz}",
        (ROOT / "calibration" / "twin.toml").read_text(),
    )
    assert found == 1
    file = folder / "twin-at-rate.toml"
    file.write_text(text)
    return file


def hand_of(served: Server):
    """Who sets the height when the run asks for it."""

    def hand(prompt: str = "") -> str:
        served.told(f"height {re.search(r'Set the rack to ([0-9.]+) mm', prompt)[1]}")
        return ""

    return hand


def soak(seconds: float, rate_Hz: float, runs: Path, lenient: bool) -> None:
    with (
        tempfile.TemporaryDirectory() as place,
        serving("--rig", str(at_rate(Path(place), min(rate_Hz, 7000.0))), "--quiet") as served,
    ):
        os.environ["CAN_CONFIG"] = json.dumps(
            {"host": served.host, "port": served.ports["can_port"]}
        )
        builtins.input = hand_of(served)
        rig = real_rig(Path(place), served)
        rig = rig.model_copy(
            update={
                "force_sensor": rig.force_sensor.model_copy(
                    update={"rate_Hz": min(rate_Hz, 7000.0)}
                )
            }
        )
        seen = Watched(time.monotonic() + seconds)
        number = len(list(runs.glob("soak-*")))
        while time.monotonic() < seen.until_s:
            number += 1
            one_run(rig, runs / f"soak-{number:03d}", seen, lenient, rate_Hz)
        print(f"{rate_Hz:.0f} records/s: {seen.text()}")
    for folder in sorted(runs.glob("soak-*")):
        damaged = [finding.file for finding in check_run(folder) if not finding.is_sound]
        print(
            f"{folder.name}: "
            f"{run_folder_text(folder)}{', DAMAGED ' + ', '.join(damaged) if damaged else ''}"
        )


def run_folder_text(folder: Path) -> str:
    stages = len(list((folder / "stages").glob("*.h5")))
    missing = sum("records missing" in finding.words for finding in check_run(folder))
    return f"{stages} stages on disk, {missing} of them with records missing"


def main() -> None:
    logging.getLogger("can").setLevel(
        logging.ERROR
    )  # python-can warns of every frame that came in two pieces
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float, default=60.0)
    parser.add_argument("--rate", type=float, default=15_000.0, help="records of force a second")
    parser.add_argument(
        "--runs",
        type=Path,
        help="where the runs stay; a folder that is gone afterwards if not given",
    )
    parser.add_argument(
        "--lenient",
        action="store_true",
        help="late ticks are measured and not tripped on, for a machine that is busy",
    )
    words = parser.parse_args()
    if words.runs is not None:
        words.runs.mkdir(parents=True, exist_ok=True)
        soak(words.seconds, words.rate, words.runs, words.lenient)
        return
    with tempfile.TemporaryDirectory() as place:
        soak(words.seconds, words.rate, Path(place), words.lenient)


if __name__ == "__main__":
    main()
