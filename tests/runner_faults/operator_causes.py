"""What the operator does, and the system on behalf of somebody: keys and signals, as the command
line hears them.
"""

import signal

from tests.runner_faults.cause import Cause
from tests.runner_faults.rig import FaultyRig

BETWEEN_PRESSES_S = 0.02


def press(rig: FaultyRig, times: int) -> None:
    """^C, so often, 20 ms apart; the first one now."""
    if times > 1:
        rig.agenda.at(rig.clock.now_s() + BETWEEN_PRESSES_S, lambda: press(rig, times - 1))
    rig.ear.key(signal.SIGINT, None)


def tell(rig: FaultyRig, number: signal.Signals) -> None:
    rig.ear.from_outside(number, None)


def _shut_down(rig: FaultyRig) -> None:
    tell(rig, signal.SIGHUP)
    tell(rig, signal.SIGTERM)


OPERATOR_CAUSES = (
    Cause(
        "^C",
        "operator",
        "^C once: on to the next safe point",
        "Stopped",
        lambda rig: press(rig, 1),
        by_press=True,
        within_ms=1400,
    ),
    Cause(
        "^C ^C",
        "operator",
        "^C twice: now",
        "Stopped",
        lambda rig: press(rig, 2),
        by_press=True,
        within_ms=30,
    ),
    Cause(
        "^C ^C ^C",
        "operator",
        "^C three times",
        "Stopped",
        lambda rig: press(rig, 3),
        by_press=True,
        within_ms=30,
    ),
    Cause(
        "SIGTERM",
        "operator",
        "the system ends the process",
        "Stopped",
        lambda rig: tell(rig, signal.SIGTERM),
        by_press=True,
        within_ms=215,
    ),
    Cause(
        "SIGHUP",
        "operator",
        "the terminal is closed",
        "Stopped",
        lambda rig: tell(rig, signal.SIGHUP),
        by_press=True,
        within_ms=215,
    ),
    Cause(
        "SIGHUP SIGTERM",
        "operator",
        "both, as at a shutdown",
        "Stopped",
        _shut_down,
        by_press=True,
        within_ms=215,
    ),
)
