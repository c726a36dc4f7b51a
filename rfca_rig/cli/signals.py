"""^C and the system's signals as wishes of a run: heard at any time, obeyed where it is safe."""

import signal
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType

from rfca_rig.cli.terminal import Say
from rfca_rig.engine.wishes import Wish, Wishes

OUTSIDE = {signal.SIGTERM: "ended by SIGTERM", signal.SIGHUP: "its terminal was closed (SIGHUP)"}


class Heard:
    """Turns a signal into a wish. Where no loop is ticking, the run waits for a person with its motor off, and is interrupted."""

    def __init__(self, wishes: Wishes, say: Say) -> None:
        self._wishes = wishes
        self._say = say
        self._presses = 0

    def key(self, _number: int, _frame: FrameType | None) -> None:
        """^C: once for the next safe point, twice for now, three times where a device hangs."""
        if self._wishes.is_over:
            return
        self._presses += 1
        if self._presses == 1 and self._wishes.is_ticking:
            self._wishes.ask(Wish.SAFE_POINT, "stopped by the operator")
            self._say("stopping at the next safe point; ^C again takes the torque away now")
            return
        self._wishes.ask(Wish.LET_GO, "stopped at once by the operator")
        if self._presses > 2 or not self._wishes.is_ticking:
            raise KeyboardInterrupt

    def from_outside(self, number: int, _frame: FrameType | None) -> None:
        """The system wants the process to end: the shaft slows down, then the motor lets go."""
        if self._wishes.is_over:
            return
        self._wishes.ask(Wish.EASE, OUTSIDE[signal.Signals(number)])
        if not self._wishes.is_ticking:
            raise KeyboardInterrupt


@contextmanager
def heard(wishes: Wishes, say: Say) -> Iterator[None]:
    """Within the block, signals are wishes; afterwards they are what they were before."""
    ear = Heard(wishes, say)
    handlers = {signal.SIGINT: ear.key, signal.SIGTERM: ear.from_outside, signal.SIGHUP: ear.from_outside}
    before = {number: signal.signal(number, handler) for number, handler in handlers.items()}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
