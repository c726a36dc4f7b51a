"""What the live view costs a run of 15 kHz, and what it shows of it.

Run: python -m tests.benchmarks.live_view [--seconds 60] [--short]

As in `soak` the twin server is the rig and a sender the force sensor, whose every axis jumps about
so that each record may be a peak. The engine runs at 500 Hz with the recorder behind it, in turn
without and with a view, which has one page open that takes in everything in a process of its own.
Shown are: how late ticks come in either case; what a tick costs to hand over; processor shares in
per cent of one core; the time from a sample to the message that brings it; and how many of the
recording's extrema are found in what was sent. Those are the least and the greatest of every
channel in every 20 ms of every stroke.
"""

import argparse
import builtins
import json
import logging
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Mapping
from contextlib import ExitStack, closing, contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from websockets.exceptions import ConnectionClosed

from rfca_rig.acquisition.acquired import AcquiredDatagrams
from rfca_rig.bench.factory import open_bench
from rfca_rig.bench.recorder import Recorder
from rfca_rig.clock import Clock
from rfca_rig.description.rig_file import RigFile
from rfca_rig.devices.netft.driver import NetFtSensor, record_source
from rfca_rig.devices.netft.section import NetFtSettings
from rfca_rig.engine.interfaces import NULL_OBSERVER, RunObserver, StopRequest, Tick
from rfca_rig.engine.run import Supervision, run_plan
from rfca_rig.errors import RigError
from rfca_rig.protocol.check import Load
from rfca_rig.protocol.plan import Plan, Rest, Stage
from rfca_rig.recording import run_folder
from rfca_rig.recording.backend import RecorderClient
from rfca_rig.recording.model import Recording, Stroke
from rfca_rig.view.messages import WRENCH
from rfca_rig.view.run_facts import run_facts
from rfca_rig.view.run_queue import LiveView
from tests.acquisition.sender import restless, sending
from tests.benchmarks.soak import TimeIsUp, at_rate, hand_of, plan_of
from tests.twin_server.server import serving
from tests.twin_server.test_real_run import real_rig
from tests.view.pages import stream_of

RATE_HZ = 15_000.0
PIECE_S = 0.02
TOLD_TO = 1e-4  # decimals of what is sent
TICKS_PER_S = 100.0  # of /proc/PID/stat on Linux
REST_S = 0.2
WARM_S = 2.0  # until the first stroke


class Timed:
    """An observer that hands on, and notes how late every tick came, and what it cost to hand it
    over.
    """

    def __init__(self, observer: RunObserver) -> None:
        self._observer = observer
        self.began: tuple[float, float] | None = None
        self.late_s: list[float] = []
        self.cost_s: list[float] = []

    def stage(self, stage: Stage, expected: Load | None, turns_rad: float | None) -> None:
        self._observer.stage(stage, expected, turns_rad)

    def start(self, start_s: float) -> None:
        self._observer.start(start_s)

    def energising(self) -> None:
        self._observer.energising()

    def pause(self, is_paused: bool) -> None:
        self._observer.pause(is_paused)

    def tick(self, tick: Tick) -> None:
        begin_s = time.monotonic()
        self.began = self.began or (begin_s, tick.now_s)
        self._observer.tick(tick)
        self.cost_s.append(time.monotonic() - begin_s)
        self.late_s.append(tick.late_s)


@dataclass
class Outcome:
    """One run. `shares` are processor shares in per cent by name of the process."""

    timed: Timed
    strokes: list[Stroke]
    shares: Mapping[str, float]
    why: str
    zero_s: float
    sent: list[dict[str, Any]] = field(default_factory=list)
    lost: int = 0

    def ticks(self) -> str:
        late = 1e3 * np.array(self.timed.late_s)
        cost = 1e6 * np.array(self.timed.cost_s)
        cost_text = (
            f"handing over {np.median(cost):.0f} us, p99 {np.percentile(cost, 99):.0f}, worst "
            f"{cost.max():.0f} us"
        )
        late_text = (
            f"p99 {np.percentile(late, 99):.2f}, p99.9 {np.percentile(late, 99.9):.2f}, worst "
            f"{late.max():.1f} ms"
        )
        return f"{len(late)} ticks late by {late_text}; {cost_text}"


@contextmanager
def page_on(url: str, folder: Path) -> Iterator[Path]:
    """A page in a process of its own; afterwards the file holds what it was sent, each message
    after the moment it came.
    """
    file = folder / "messages.jsonl"
    page = subprocess.Popen(
        [sys.executable, "-m", "tests.benchmarks.live_view", "--page", url, "--to", str(file)]
    )
    while not file.exists():
        time.sleep(0.05)
    yield file
    page.wait(30.0)


def look(url: str, file: Path) -> None:
    """The page."""
    came: list[tuple[float, str]] = []
    with stream_of(url) as socket:
        came.append((time.monotonic(), str(socket.recv())))
        file.touch()
        try:
            while not any('"ended":"' in text for _, text in came[-3:]):
                text = str(socket.recv())
                came.append((time.monotonic(), text))
        except ConnectionClosed:
            pass
    file.write_text("".join(f"{came_s:.6f} {text}\n" for came_s, text in came))


def messages_in(file: Path) -> list[dict[str, Any]]:
    lines = (line.split(" ", 1) for line in file.read_text().splitlines())
    return [{**json.loads(text), "came_s": float(came_s)} for came_s, text in lines]


def cpu_s(process_id: int | str) -> float:
    words = Path(f"/proc/{process_id}/stat").read_text().rsplit(")", 1)[1].split()
    return (int(words[11]) + int(words[12])) / TICKS_PER_S


@contextmanager
def restless_sensor(clock: Clock) -> Iterator[NetFtSensor]:
    with (
        sending(RATE_HZ, 40, 1e6, restless) as (port, _),
        closing(AcquiredDatagrams(record_source("127.0.0.1", port), clock)) as datagrams,
    ):
        yield NetFtSensor(
            datagrams, clock, NetFtSettings(rate_Hz=RATE_HZ, internal_rate_Hz=RATE_HZ)
        )


def one_run(rig: RigFile, plan: Plan, folder: Path, seconds: float, has_view: bool) -> Outcome:
    with open_bench(rig, None) as opened, ExitStack() as things:
        bench = replace(opened, sensor=things.enter_context(restless_sensor(opened.clock)))
        run_folder.create(folder, Recording("live view", "REAL", rig.nominal(), {}, (), ()))
        keeper = RecorderClient(folder, patient=False)
        stop_request = StopRequest()
        recorder = Recorder(keeper, bench.sensor.scale(), bench.clock)
        processes: dict[str, int | str] = {"loop": "self", "recorder": keeper.process_id}
        view = None
        file = None
        if has_view:
            facts = run_facts(
                plan,
                "REAL",
                bench.sensor.scale(),
                rig.nominal(),
                rig.known_to.model_dump(exclude_none=True),
            )
            view = LiveView(
                facts,
                plan,
                stop_request,
                lambda: (bench.sensor.health(), keeper.backlog_bytes),
                print,
                0,
            )
            file = things.enter_context(page_on(view.url, folder))
            processes["view"] = view.process_id
            time.sleep(WARM_S)  # the shapes of the leg
        timed = Timed(NULL_OBSERVER if view is None else view.run_queue)
        zero_s = time.monotonic() - bench.clock.now_s()
        before_s = {name: cpu_s(number) for name, number in processes.items()}
        began_s = time.monotonic()

        def progress(_: Stage) -> None:
            if time.monotonic() > began_s + seconds:
                raise TimeIsUp

        why = "done"
        try:
            run_plan(
                plan,
                bench,
                recorder,
                progress,
                Supervision(stop_request=stop_request, observer=timed),
            )
        except TimeIsUp:
            why = "time is up"
        except RigError as error:
            why = str(error)
        lasted_s = time.monotonic() - began_s
        shares = {
            name: 100.0 * (cpu_s(number) - before_s[name]) / lasted_s
            for name, number in processes.items()
        }
        if view is not None:
            view.run_queue.ended(why, "")
            view.close()
        keeper.finish(why)
    strokes = list(run_folder.read_stages(folder).strokes)
    sent = [] if file is None else messages_in(file)
    if view is not None:
        view._process.kill()
    return Outcome(
        timed, strokes, shares, why, zero_s, sent, 0 if view is None else view.run_queue.lost
    )


def soon_at_rest(plan: Plan) -> Plan:
    """For a sensor that never comes to rest."""
    shorter = [
        replace(stage, settle=replace(stage.settle, limit_s=REST_S))
        if isinstance(stage, Rest)
        else stage
        for stage in plan.stages
    ]
    return replace(plan, stages=tuple(shorter))


def delays_ms(outcome: Outcome) -> np.ndarray:
    """From the middle of every bucket until it came, on the clock that all processes share; what
    was there before the page is left out.
    """
    began_s = outcome.timed.began[1] + outcome.zero_s
    found = []
    for message in outcome.sent:
        if message["kind"] == "trace" and not message.get("reset"):
            buckets = np.arange(len(message["low"]["fz_N"])) + 0.5
            found.append(
                message["came_s"] - began_s - message["from_s"] - message["dt_s"] * buckets
            )
    return 1e3 * np.concatenate(found)


def drawn(outcome: Outcome, side: str) -> dict[str, tuple[np.ndarray, np.ndarray]]:
    """For each channel the beginnings of the buckets that were sent, and their values."""
    traces = [message for message in outcome.sent if message["kind"] == "trace"]
    begins_s = np.concatenate(
        [trace["from_s"] + trace["dt_s"] * np.arange(len(trace[side]["fz_N"])) for trace in traces]
    )
    names = [channel.name for channel in WRENCH]
    return {
        name: (
            begins_s,
            np.array([np.nan if v is None else v for trace in traces for v in trace[side][name]]),
        )
        for name in names
    }


def extrema_found(outcome: Outcome) -> tuple[int, int]:
    """(found, all): of each piece of each stroke and channel the least and the greatest, in the
    buckets that the piece lies in.

    A bucket more on either side, for the view knows less of the stream's delay than the recording
    does.
    """
    found = every = 0
    for side, extreme, sign in (("low", np.min, 1.0), ("high", np.max, -1.0)):
        shown = drawn(outcome, side)
        for stroke in outcome.strokes:
            force = stroke.streams["force"]
            # The record that took the least time to the host shows where the clocks meet.
            host_start_s = np.min(force.columns["host_s"].values - force.t_s)
            start_s = host_start_s - outcome.timed.began[1]
            for name, (begins_s, values) in shown.items():
                t_s, recorded = stroke.channel(name)
                for piece in np.split(
                    np.arange(len(t_s)), np.flatnonzero(np.diff((t_s / PIECE_S).astype(int))) + 1
                ):
                    at_s = t_s[piece] + start_s
                    near = slice(*np.searchsorted(begins_s, [at_s[0] - 0.016, at_s[-1] + 0.009]))
                    every += 1
                    least = np.nanmin(sign * values[near], initial=np.inf)
                    found += least <= sign * extreme(recorded[piece]) + TOLD_TO
    return int(found), every


def told(outcome: Outcome) -> Iterator[str]:
    yield (
        f"  {outcome.ticks()}; "
        f"{', '.join(f'{name} {share:.0f} %' for name, share in outcome.shares.items())} of a "
        f"core; {outcome.why}"
    )
    if outcome.sent:
        delays = delays_ms(outcome)
        found, every = extrema_found(outcome)
        size = sum(len(json.dumps(message)) for message in outcome.sent)
        yield (
            f"  {len(outcome.strokes)} strokes, {found} of {every} extrema found in what "
            "was sent; from sample to message "
            f"p50 {np.percentile(delays, 50):.0f}, p99 {np.percentile(delays, 99):.0f}, "
            f"worst {delays.max():.0f} ms; "
            f"{len(outcome.sent)} messages, "
            f"{1e-3 * size / (outcome.sent[-1]['came_s'] - outcome.sent[0]['came_s']):.0f} "
            f"kB/s; {outcome.lost} records lost to the view"
        )


def benchmark(seconds: float, rounds: int) -> None:
    logging.getLogger("can").setLevel(
        logging.ERROR
    )  # python-can warns of every frame that came in two pieces
    with (
        tempfile.TemporaryDirectory() as place,
        serving("--rig", str(at_rate(Path(place), 7000.0)), "--quiet") as served,
    ):
        os.environ["CAN_CONFIG"] = json.dumps(
            {"host": served.host, "port": served.ports["can_port"]}
        )
        builtins.input = hand_of(served)
        rig = real_rig(Path(place), served)
        plan = soon_at_rest(plan_of(rig, lenient=True, rate_Hz=RATE_HZ))
        for number in range(2 * rounds):
            has_view = number % 2 == 1
            print("with a view and a page" if has_view else "without a view", flush=True)
            for line in told(one_run(rig, plan, Path(place) / f"run-{number}", seconds, has_view)):
                print(line, flush=True)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float, default=60.0, help="of each run")
    parser.add_argument("--short", action="store_true", help="one run of 10 s of either kind")
    parser.add_argument("--page", help=argparse.SUPPRESS)
    parser.add_argument("--to", type=Path, help=argparse.SUPPRESS)
    words = parser.parse_args()
    if words.page:
        look(words.page, words.to)
    else:
        benchmark(10.0 if words.short else words.seconds, 1 if words.short else 2)


if __name__ == "__main__":
    main()
