"""From each cause of the fault table to the last torque of the drive, over the wire: python -m tests.benchmarks.stop_times [NAMES]

A run as on a real rig, with the wall clock and a recorder process, against a twin server in a process of its own. A proxy on the CAN bus
damages frames and sees when the drive last reports a torque. Each cause is tried several times on an idle machine, and while every core has
a process that computes. Causes that neither the server nor the proxy can bring about are listed as not measured. With --record the times go
to `tests/runner_faults/stop_times.json`, from where the fault table takes them.
"""

import argparse
import json
import os
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

from rfca_rig.devices.odrive.messages import ERROR_BITS, AxisState, OdriveCommand
from tests.runner_faults.cause import GOES_ON
from tests.runner_faults.causes import CAUSES
from tests.runner_faults.over_the_wire import Wire, WireRun, run_with_fault, served_rig
from tests.runner_faults.table import STOP_TIMES

TRIES = 5
# A busy machine may be late for its own reasons: such a run says nothing about the cause, and is tried again.
MACHINE_CODES = frozenset({"C-01", "S-01", "D-03", "DeviceError"})
MAX_RETRIES = 3
# As many as there are, so that none is left for the run alone.
CORES = os.cpu_count() or 1

Begin = Callable[[Wire], float]


def panel(name: str) -> Begin:
    """A fault of the twin server."""

    def begin(wire: Wire) -> float:
        begun_s = time.monotonic()
        assert wire.server.told(f"on {name}") == "ok\n"
        return begun_s

    return begin


def frames(kind: str, command: OdriveCommand, **values: float | str) -> Begin:
    """A fault of the proxy, on the frames with that command of node 0."""
    return lambda wire: wire.proxy.damage({"kind": kind, "can_id": int(command), **values})


def kill_recorder(wire: Wire) -> float:
    return wire.kill_recorder()


def stand(_wire: Wire) -> float:
    """The process stands for half a second."""
    begun_s = time.monotonic()
    subprocess.Popen(["sh", "-c", f"kill -STOP {os.getpid()}; sleep 0.5; kill -CONT {os.getpid()}"])
    return begun_s


def press(*numbers: signal.Signals) -> Begin:
    def begin(_wire: Wire) -> float:
        begun_s = time.monotonic()
        for number in numbers:
            os.kill(os.getpid(), number)
            # Long enough for the handler to run in the main thread, so that a second key is not the first one again.
            time.sleep(0.005)
        return begun_s

    return begin


def _drive_errors() -> dict[str, Begin]:
    """The heartbeat reports the error, and the drive itself does not stop: the slowest case."""
    named = {f"drive-{name.lower().replace('_', '-')}": bit for bit, (name, _) in ERROR_BITS.items()}
    return {name: frames("error", OdriveCommand.HEARTBEAT, word=1 << bit) for name, bit in named.items()}


IDLE = AxisState.IDLE.to_bytes(4, "little").hex()
BEGINNINGS: dict[str, Begin] = {
    **{name: panel(name) for name in ("force-silent", "box-restart", "stream-stolen", "force-frozen", "force-stuck", "force-saturated")},
    **{name: panel(name) for name in ("force-twice", "force-lost")},
    **_drive_errors(),
    "idle-unasked": panel("idle-unasked"),
    "idle-from-elsewhere": frames("send", OdriveCommand.AXIS_STATE, data=IDLE),
    "e-stop-frame": frames("send", OdriveCommand.ESTOP),
    "heartbeat-silent": panel("heartbeat-silent"),
    "encoder-silent": frames("drop", OdriveCommand.ENCODER_ESTIMATES),
    "encoder-silent-held": frames("drop", OdriveCommand.ENCODER_ESTIMATES),
    "encoder-late": frames("delay", OdriveCommand.ENCODER_ESTIMATES, late_s=0.2),
    "torque-silent": frames("drop", OdriveCommand.TORQUES),
    "encoder-nan": frames("nan", OdriveCommand.ENCODER_ESTIMATES),
    "encoder-nan-held": frames("nan", OdriveCommand.ENCODER_ESTIMATES),
    "encoder-absurd": frames("absurd", OdriveCommand.ENCODER_ESTIMATES),
    "encoder-nan-twice": frames("nan", OdriveCommand.ENCODER_ESTIMATES, frames=2),
    "torque-nan": frames("nan", OdriveCommand.TORQUES),
    "temperature-nan": frames("nan", OdriveCommand.TEMPERATURES),
    "encoder-frozen": panel("encoder-frozen"),
    "encoder-jump": panel("encoder-jump"),
    "drive-restart": panel("drive-restart"),
    "adapter-unplugged": frames("unplug", OdriveCommand.VERSION),
    "can-silent": panel("can-silent"),
    "can-silent-held": panel("can-silent"),
    "bus-off": panel("bus-off"),
    "can-short": panel("can-short"),
    "can-twice": panel("can-twice"),
    "own-frame-echo": panel("own-frame-echo"),
    "stopped-for-a-while": stand,
    "recorder-died": kill_recorder,
    "^C": press(signal.SIGINT),
    "^C ^C": press(signal.SIGINT, signal.SIGINT),
    "SIGTERM": press(signal.SIGTERM),
    "SIGHUP": press(signal.SIGHUP),
}
# Silences or damages the frames for the observer too: what is seen last is not the last torque.
UNSEEN = frozenset({"can-silent", "can-silent-held", "bus-off", "can-short"})


@dataclass(frozen=True)
class Measured:
    """The code or error that ended each try of a cause, and the times in ms of those that ended as they should."""

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
    """All tries of one cause, against one server; a drive that lost its zero gets a new server."""
    measured = Measured([], [])
    while len(measured.ends) < tries:
        with tempfile.TemporaryDirectory() as folder, served_rig(Path(folder)) as (server, rig):
            for _ in range(tries - len(measured.ends)):
                run = _try(name, lambda begin, in_hold: run_with_fault(server, rig, begin, in_hold))
                server.told("off all")
                measured.ends.append(run.ended)
                if run.ended == CAUSES[name].ends and not isnan(run.torque_s):
                    measured.times_ms.append(1e3 * run.torque_s)
                if name in {"drive-restart", "encoder-frozen"}:
                    break
    return measured


def _try(name: str, run: Callable[[Begin, bool], WireRun]) -> WireRun:
    wanted = CAUSES[name].ends
    for _ in range(MAX_RETRIES):
        result = run(BEGINNINGS[name], CAUSES[name].in_hold)
        by_machine = result.ended in MACHINE_CODES and wanted not in MACHINE_CODES
        if not by_machine and (result.ended != wanted or not isnan(result.begun_s)):
            return result
    return result


def describe(name: str, measured: Measured) -> str:
    wanted = CAUSES[name].ends
    other = "" if set(measured.ends) == {wanted} else f"; ended as {', '.join(sorted(set(measured.ends)))}, not {wanted}"
    if wanted == GOES_ON:
        return f"goes on{other}"
    times_ms = measured.times_ms
    if not times_ms:
        return f"no time measured{other}"
    return f"median {statistics.median(times_ms):.0f} ms, {min(times_ms):.0f} to {max(times_ms):.0f} ms in {len(times_ms)} tries{other}"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("names", nargs="*", help="causes; without any, all that can be measured")
    parser.add_argument("--tries", type=int, default=TRIES)
    parser.add_argument("--record", action="store_true", help="keep the times for the fault table")
    arguments = parser.parse_args()
    names = arguments.names or [name for name in CAUSES if name in BEGINNINGS and name not in UNSEEN]
    kept = json.loads(STOP_TIMES.read_text(encoding="utf-8")) if STOP_TIMES.is_file() else {}
    for name in names:
        idle = measure(name, arguments.tries)
        print(f"{name:34s} idle: {describe(name, idle)}", flush=True)
        with busy_cores():
            busy = measure(name, arguments.tries)
        print(f"{'':34s} busy: {describe(name, busy)}", flush=True)
        kept[name] = {
            state: {"times_ms": [round(ms, 1) for ms in one.times_ms], "ends": one.ends} for state, one in (("idle", idle), ("busy", busy))
        }
        if arguments.record:
            STOP_TIMES.write_text(json.dumps(kept, indent=1, sort_keys=True) + "\n", encoding="utf-8")
    unmeasured = [name for name in CAUSES if name not in BEGINNINGS or name in UNSEEN]
    print(f"not measured, because neither the server nor the proxy can bring them about or see the drive then: {', '.join(unmeasured)}")


if __name__ == "__main__":
    main()
