"""The fault table: every cause, what ended the run, and how long the motor went on."""

import json
import statistics
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

import numpy as np

from tests.runner_faults.cause import GOES_ON, Cause
from tests.runner_faults.endings import ENDINGS
from tests.runner_faults.outcome import Outcome, caused
from tests.runner_faults.rig import Fidelity

# Times over the wire, written by `tests.benchmarks.stop_times`.
STOP_TIMES = Path(__file__).with_name("stop_times.json")
FAULT_TABLE = Path(__file__).parents[2] / "docs" / "fault-table.md"

HEAD = """# Fault table: what can go wrong, and what the runner does then

Made by `python -m tests.runner_faults docs/fault-table.md` from the causes in `tests/runner_faults`. They act on the twin of an ODrive
with a watchdog of 0.1 s, {plant}.
Each begins in the middle of a stroke at 5 rad/s unless it says otherwise. Times and angles are the simulated shaft's own, from the
moment at which the cause begins: until the motor gives no torque any more, and until the shaft stands. A shaft without torque coasts,
and the leg swings on it as on a hinge. A dash means: not within {watched:g} s after the run. Limits are those of `calibration/twin.toml`;
[Trips](trips.md) explains the codes.

"Over the wire" is measured with the wall clock and sockets, by `python -m tests.benchmarks.stop_times --record`. It runs the same
stroke against `rfca-rig twin serve` in a process of its own, which brings the cause about as in simulated time. Errors of the adapter come
from the program's end of the bus, signals from the system. The time goes from the cause until the motor gives no torque, as the server sees
it. The two numbers are medians of up to five tries: without further load, and with a computing process on every core. Tries that ended
for another reason, such as a late machine, are not among them. Of 54 of the 86 causes, other programs computed on the machine both times.

Both times agree within a factor of two and one period of what the program waits for. That is 6 ms: two ticks of the control loop and a
step of the server. It is 100 ms for the heartbeat and 500 ms for the temperatures. Of a recorder that was killed it is 15 ms, until the
system has closed its connection. `--compare` prints the causes where they do not agree.

A drive that reports an error stops by itself, which takes no time. One that reports an error and goes on is stopped by the program with the
next heartbeat: after 83 ms (median; 76 to 87 ms in 5 tries).

"Not measured" are six causes that cannot be brought about. A socket without a network raises nothing while the
program only listens (`network-gone`). A full queue takes seconds to fill (`recorder-behind`), a full disk needs a file system of its own
(`disk-full`). The server has no camera (`camera-frozen`, `camera-gone`). The computer's clock is not set for a test (`wall-clock-set`).

"Energised after" is what the motor did after the run had ended. Where no command reached the drive any more, its own watchdog removed
the torque. Then the last line on the screen asks for the emergency stop. "Frames" are motion commands sent after the first order to
disable it. "Lost" are stages that had been acknowledged as safe and cannot be read back.

| cause | what happens | ends as | over the wire, idle, busy | torque gone after | stands after | energised after | frames | lost |
|---|---|---|---|---|---|---|---|---|"""

FOOT = """
## When the process of the run gets a signal, is stopped or killed

Each line has a test in `tests/runner_faults/test_signals.py`, with real processes. A drive without a watchdog of its own has a guardian
process in the place of one.

| event | exit code | motor | recording |
|---|---|---|---|"""


def rows(causes: Mapping[str, Cause], fidelity: Fidelity) -> Iterator[str]:
    """One line of Markdown each, as they come."""
    memory = Path("/dev/shm")
    with tempfile.TemporaryDirectory(dir=memory if memory.is_dir() else None) as folder:
        for number, cause in enumerate(causes.values()):
            yield row(cause, caused(cause, Path(folder) / str(number), fidelity))


def head(fidelity: Fidelity) -> str:
    arm = "turning an arm that swings and brushes a soft floor, force at 250 Hz"
    leg = "turning the leg of the paper, force at 7 kHz"
    return HEAD.format(
        watched=fidelity.watched_s, plant=arm if fidelity.plant == "pendulum" else leg
    )


def foot() -> str:
    """The second table: the process itself."""
    cells = ((end.event, end.exit_code, end.motor, end.recording) for end in ENDINGS)
    return "\n".join([FOOT, *(f"| {' | '.join(row)} |" for row in cells)])


def row(cause: Cause, outcome: Outcome) -> str:
    stop = outcome.stop
    goes_on = outcome.ended == GOES_ON
    cells = (
        cause.name,
        cause.what,
        outcome.ended,
        over_the_wire(cause),
        "" if goes_on else _ms_and_deg(stop.torque_ms, stop.torque_deg),
        "" if goes_on else _ms_and_deg(stop.stands_ms, stop.stands_deg),
        "never"
        if outcome.energised_s == 0.0
        else f"{1e3 * outcome.energised_s:.0f} ms, until the drive's watchdog",
        str(outcome.motion_frames),
        str(outcome.lost),
    )
    return f"| {' | '.join(cells)} |"


def over_the_wire(cause: Cause) -> str:
    """Median times of the kept measurements, idle and busy."""
    kept = json.loads(STOP_TIMES.read_text(encoding="utf-8")).get(cause.name)
    if kept is None:
        return "not measured"
    if cause.ends == GOES_ON:
        return "goes on"
    return ", ".join(_median_text(kept[state]["times_ms"]) for state in ("idle", "busy"))


def _median_text(times_ms: Sequence[float]) -> str:
    if times_ms:
        return f"{max(statistics.median(times_ms), 0.0):.0f} ms"
    return "not measured"


def _ms_and_deg(time_ms: float, way_deg: float) -> str:
    if np.isnan(time_ms):
        return "-"
    return f"{time_ms:.0f} ms, {way_deg:.1f} deg"
