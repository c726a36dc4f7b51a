"""The fault table: every cause, what ended the run, and how long the motor went on."""

import tempfile
from collections.abc import Iterator, Mapping
from pathlib import Path

import numpy as np

from tests.runner_faults.cause import GOES_ON, Cause
from tests.runner_faults.endings import ENDINGS
from tests.runner_faults.outcome import Outcome, caused
from tests.runner_faults.rig import Fidelity

# Times over the wire, written by `tests.benchmarks.stop_times`.
STOP_TIMES = Path(__file__).with_name("stop_times.json")

HEAD = """# Fault table: what can go wrong, and what the runner does then

Made by `python -m tests.runner_faults docs/fault-table.md` from the causes in `tests/runner_faults`. They act on the twin of an ODrive
with a watchdog of 0.1 s, {plant}.
Each begins in the middle of a stroke at 5 rad/s unless it says otherwise. Times and angles are the simulated shaft's own, from the
moment at which the cause begins: until the motor gives no torque any more, and until the shaft stands. A shaft without torque coasts,
and the leg swings on it as on a hinge. A dash means: not within {watched:g} s after the run. Limits are those of `calibration/twin.toml`;
[Trips](trips.md) explains the codes.

"Energised after" is what the motor did after the run had ended. Where no command reached the drive any more, its own watchdog removed
the torque. Then the last line on the screen asks for the emergency stop. "Frames" are motion commands sent after the first order to
disable it. "Lost" are stages that had been acknowledged as safe and cannot be read back.

| cause | what happens | ends as | torque gone after | stands after | energised after | frames | lost |
|---|---|---|---|---|---|---|---|"""

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
    return HEAD.format(watched=fidelity.watched_s, plant=arm if fidelity.plant == "pendulum" else leg)


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
        "" if goes_on else _ms_and_deg(stop.torque_ms, stop.torque_deg),
        "" if goes_on else _ms_and_deg(stop.stands_ms, stop.stands_deg),
        "never" if outcome.energised_s == 0.0 else f"{1e3 * outcome.energised_s:.0f} ms, until the drive's watchdog",
        str(outcome.motion_frames),
        str(outcome.lost),
    )
    return f"| {' | '.join(cells)} |"


def _ms_and_deg(time_ms: float, way_deg: float) -> str:
    return "-" if np.isnan(time_ms) else f"{time_ms:.0f} ms, {way_deg:.1f} deg"
