"""From each cause of the fault table to the last torque of the motor, over the wire.

Run: python -m tests.benchmarks.stop_times [NAMES]

A run as on a real rig, with the wall clock and a recorder process, against a twin server in a
process of its own. The server brings the cause about by the same function as in simulated time, and
tells when its motor last gave torque. Errors of the adapter come from this process's end of the
bus, and signals from the system. Each cause is tried several times without further load, and while
every core has a process that computes. What cannot be brought about like this is listed as not
measured. With --record the times go to `tests/runner_faults/stop_times.json`, from where the fault
table takes them; --compare only compares those with the simulated ones.
"""

import argparse
import json
import os
import re
import signal
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from math import isnan
from pathlib import Path
from types import SimpleNamespace

import can

from rfca_rig.description.rig_file import RigFile
from tests.runner_faults.cause import GOES_ON
from tests.runner_faults.causes import CAUSES
from tests.runner_faults.fault_server import FAULT_SERVER, PERMANENT
from tests.runner_faults.operator_causes import BETWEEN_PRESSES_S
from tests.runner_faults.over_the_wire import (
    Wire,
    WireRun,
    run_with_fault,
    served_guarded_rig,
    served_rig,
)
from tests.runner_faults.table import FAULT_TABLE, STOP_TIMES
from tests.twin_server.server import Server

TRIES = 5
# A busy machine may be late for its own reasons: such a run says nothing about the cause, and is
# tried again.
MACHINE_CODES = frozenset({"C-01", "S-01", "D-03", "DeviceError"})
MAX_RETRIES = 3
# As many as there are, so that none is left for the run alone.
CORES = os.cpu_count() or 1
LATE_S = 0.08
STANDS_S = 0.5

Begin = Callable[[Wire], float]


def serve(name: str) -> Begin:
    """The server brings the cause about."""
    return lambda wire: float(wire.server.told(f"cause {name}").split()[0])


def unplug(wire: Wire) -> float:
    """The connection to the bus is cut."""
    return wire.proxy.damage({"kind": "unplug", "can_id": 0})


def break_adapter(name: str) -> Begin:
    """This process's end of the bus fails, by the same function as in simulated time."""

    def begin(wire: Wire) -> float:
        adapter = wire.adapter

        def receive(message: can.Message) -> None:
            """The adapter's next frame is this one."""
            messages = [message]
            adapter.alter = lambda received: messages.pop() if messages else received

        begun_s = time.monotonic()
        CAUSES[name].begin(
            SimpleNamespace(
                bus=adapter, clock=adapter._clock, observer=SimpleNamespace(send=receive)
            )
        )
        return begun_s

    return begin


def stand(seconds: float) -> Begin:
    """This process stands still for so long."""

    def begin(_wire: Wire) -> float:
        begun_s = time.monotonic()
        subprocess.Popen(
            ["sh", "-c", f"kill -STOP {os.getpid()}; sleep {seconds:g}; kill -CONT {os.getpid()}"]
        )
        return begun_s

    return begin


def press(*numbers: signal.Signals) -> Begin:
    def begin(_wire: Wire) -> float:
        begun_s = time.monotonic()
        for number in numbers:
            os.kill(os.getpid(), number)
            # As in simulated time.
            time.sleep(BETWEEN_PRESSES_S)
        return begun_s

    return begin


ADAPTER = ("frames-refused", "queue-full", "receiving-fails", "bus-off-frame", "error-passive")
# Why each of these has no time over the wire.
NOT_MEASURED = {
    "network-gone": (
        "a socket without a network raises nothing while the program only listens; it is silent"
    ),
    "recorder-behind": "the cause is the full queue itself, which takes seconds to fill",
    "disk-full": (
        "it would take a file system of its own, which only the system's administrator can make"
    ),
    "camera-frozen": "the server has no camera",
    "camera-gone": "the server has no camera",
    "wall-clock-set": "it would set the clock of the computer",
}
BEGINNINGS: dict[str, Begin] = {
    **{
        name: serve(name)
        for name, cause in CAUSES.items()
        if cause.family in {"sensor", "drive", "bus"} and name not in NOT_MEASURED
    },
    **{name: break_adapter(name) for name in ADAPTER},
    "adapter-unplugged": unplug,
    "late": stand(LATE_S),
    "stopped-for-a-while": stand(STANDS_S),
    "recorder-died": Wire.kill_recorder,
    "^C": press(signal.SIGINT),
    "^C ^C": press(signal.SIGINT, signal.SIGINT),
    "^C ^C ^C": press(signal.SIGINT, signal.SIGINT, signal.SIGINT),
    "SIGTERM": press(signal.SIGTERM),
    "SIGHUP": press(signal.SIGHUP),
    "SIGHUP SIGTERM": press(signal.SIGHUP, signal.SIGTERM),
}

# Up to one period passes before a report shows what became of the drive. Twice the control loop's
# tick of 2 ms, and a step of the server's twins of 2 ms; the drive's heartbeat every 100 ms, and
# its temperatures every 500 ms. The system takes up to some 10 ms to close the connections of a
# process that was killed, which simulated time has no part of.
TICK_MS = 6.0
PERIODS_MS = {
    "heartbeat-silent": 100.0,
    "temperature-nan": 500.0,
    "drive-hot": 500.0,
    "recorder-died": 15.0,
}
MAX_RATIO = 2.0


@dataclass(frozen=True)
class Measured:
    """The code or error that ended each try of a cause, and the times in ms of those that ended
    as they should.
    """

    times_ms: list[float]
    ends: list[str]


@contextmanager
def busy_cores() -> Iterator[None]:
    """Within the block every core computes."""
    command = [sys.executable, "-c", "while True: pass"]
    processes = [subprocess.Popen(command) for _ in range(CORES)]
    try:
        yield
    finally:
        for process in processes:
            process.kill()
            process.wait()


def measure(name: str, tries: int) -> Measured:
    """All tries of one cause, against one server; a drive that is not as before gets a new
    server.
    """
    measured = Measured([], [])
    while len(measured.ends) < tries:
        with (
            tempfile.TemporaryDirectory() as folder,
            served_rig(Path(folder), FAULT_SERVER) as (server, rig),
        ):
            for _ in range(tries - len(measured.ends)):
                run = _try(name, server, rig)
                measured.ends.append(run.ended)
                if run.ended == CAUSES[name].ends and not isnan(run.torque_s):
                    measured.times_ms.append(1e3 * run.torque_s)
                if name in PERMANENT:
                    break
    return measured


def _try(name: str, server: Server, rig: RigFile) -> WireRun:
    cause = CAUSES[name]
    for _ in range(MAX_RETRIES):
        result = run_with_fault(server, rig, BEGINNINGS[name], cause.in_hold, cause)
        server.told("heal")
        # Also where the torque was gone before the cause began.
        by_machine = (
            result.ended in MACHINE_CODES and cause.ends not in MACHINE_CODES
        ) or 1e3 * result.torque_s < -TICK_MS
        if not by_machine and (result.ended != cause.ends or not isnan(result.begun_s)):
            return result
    return result


def measure_killed_guardian(tries: int) -> list[float]:
    """Times in ms to the last torque that an AK drive reports, held and moving in turn; runs
    that end for another reason are repeated.
    """
    times_ms: list[float] = []
    with tempfile.TemporaryDirectory() as folder, served_guarded_rig(Path(folder)) as (server, rig):
        for _ in range(MAX_RETRIES * tries):
            run = run_with_fault(server, rig, Wire.kill_guardian, in_hold=len(times_ms) % 2 == 0)
            if run.ended == "B-01" and "guardian ended by itself" in run.message:
                times_ms.append(1e3 * run.torque_s)
            if len(times_ms) == tries:
                break
    return times_ms


def describe_killed(times_ms: list[float]) -> str:
    if not times_ms:
        return "no time measured: the machine ended every run before"
    return (
        f"median {statistics.median(times_ms):.0f} ms, {min(times_ms):.0f} to "
        f"{max(times_ms):.0f} ms in {len(times_ms)} tries"
    )


def describe(name: str, measured: Measured) -> str:
    wanted = CAUSES[name].ends
    if set(measured.ends) == {wanted}:
        other = ""
    else:
        other = f"; ended as {', '.join(sorted(set(measured.ends)))}, not {wanted}"
    if wanted == GOES_ON:
        return f"goes on{other}"
    times_ms = measured.times_ms
    if not times_ms:
        return f"no time measured{other}"
    return (
        f"median {statistics.median(times_ms):.0f} ms, {min(times_ms):.0f} to "
        f"{max(times_ms):.0f} ms in {len(times_ms)} tries{other}"
    )


def simulated_ms() -> dict[str, float]:
    """Times in simulated time until the torque is gone, as the document has them."""
    rows = re.findall(
        r"^\| (\S.*?) (?:\| .*? ){3}\| (\d+) ms, .*$",
        FAULT_TABLE.read_text(encoding="utf-8"),
        re.MULTILINE,
    )
    return {name: float(time_ms) for name, time_ms in rows}


def compare(name: str, wire_ms: float, simulated: float) -> str | None:
    """How far the two times are apart, in words; None where they agree within MAX_RATIO and one
    period of what the program waits for.
    """
    period_ms = PERIODS_MS.get(name, TICK_MS)
    smaller, larger = sorted((max(wire_ms, 0.0), simulated))
    if larger <= MAX_RATIO * smaller + period_ms:
        return None
    return (
        f"{wire_ms:.0f} ms over the wire, {simulated:.0f} ms simulated, more than "
        f"{MAX_RATIO:g} x and a period of {period_ms:g} ms apart"
    )


def print_comparison() -> None:
    simulated = simulated_ms()
    kept = json.loads(STOP_TIMES.read_text(encoding="utf-8"))
    medians = {
        name: statistics.median(states["idle"]["times_ms"])
        for name, states in kept.items()
        if states["idle"]["times_ms"]
    }
    compared = {
        name: compare(name, medians[name], simulated[name]) for name in medians if name in simulated
    }
    apart = {name: words for name, words in compared.items() if words is not None}
    print(
        f"{len(kept)} causes measured over the wire, {len(compared)} of them with times "
        f"to compare, {len(apart)} apart"
    )
    for name, words in apart.items():
        print(f"{name:34s} {words}")


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("names", nargs="*", help="causes; without any, all that can be measured")
    parser.add_argument("--tries", type=int, default=TRIES)
    parser.add_argument("--record", action="store_true", help="keep the times for the fault table")
    parser.add_argument(
        "--guardian",
        action="store_true",
        help="measure only a guardian that is killed, with an AK drive",
    )
    parser.add_argument(
        "--compare",
        action="store_true",
        help="measure nothing, compare the kept times with the simulated ones",
    )
    arguments = parser.parse_args()
    if arguments.compare:
        print_comparison()
        return
    if arguments.guardian:
        print(
            (
                f"{'guardian killed':34s} idle: "
                f"{describe_killed(measure_killed_guardian(arguments.tries))}"
            ),
            flush=True,
        )
        with busy_cores():
            print(
                f"{'':34s} busy: {describe_killed(measure_killed_guardian(arguments.tries))}",
                flush=True,
            )
        return
    if STOP_TIMES.is_file():
        kept = json.loads(STOP_TIMES.read_text(encoding="utf-8"))
    else:
        kept = {}
    for name in arguments.names or BEGINNINGS:
        idle = measure(name, arguments.tries)
        print(f"{name:34s} idle: {describe(name, idle)}", flush=True)
        with busy_cores():
            busy = measure(name, arguments.tries)
        print(f"{'':34s} busy: {describe(name, busy)}", flush=True)
        states = {"idle": idle, "busy": busy}
        kept[name] = {
            state: {"times_ms": [round(ms, 1) for ms in measured.times_ms], "ends": measured.ends}
            for state, measured in states.items()
        }
        if arguments.record:
            STOP_TIMES.write_text(
                json.dumps(kept, indent=1, sort_keys=True) + "\n", encoding="utf-8"
            )
    for name, reason in NOT_MEASURED.items():
        print(f"{name:34s} not measured: {reason}")
    if arguments.record:
        print_comparison()


if __name__ == "__main__":
    main()
