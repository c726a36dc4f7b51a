"""^C and the system's signals as stop requests of a run: received at any time, obeyed where it is safe."""

import signal
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType

from rfca_rig.cli.terminal import Say
from rfca_rig.engine.interfaces import StopLevel, StopRequest

OUTSIDE = {signal.SIGTERM: "ended by SIGTERM"}
if sys.platform != "win32":  # which has no SIGHUP
    OUTSIDE[signal.SIGHUP] = "its terminal was closed (SIGHUP)"


class SignalHandler:
    """Turns a signal into a stop request.

    Where the loop does not tick, the run waits for a person with its motor off; it is then interrupted at once.
    """

    def __init__(self, stop_request: StopRequest, say: Say) -> None:
        self._stop_request = stop_request
        self._say = say
        self._presses = 0
        self._is_closing = False

    def begin_closing(self) -> None:
        """The motor is off, and everything recorded is handed over."""
        self._presses, self._is_closing = 0, True

    def key(self, _number: int, _frame: FrameType | None) -> None:
        """^C: once for the next safe point, twice for now, three times where a device hangs."""
        if self._is_closing:
            self._close_first()
            return
        # The stop is under way: an interruption now could skip the torque-off.
        if self._stop_request.is_over:
            return
        self._presses += 1
        if self._presses == 1 and self._stop_request.is_ticking:
            self._stop_request.ask(StopLevel.SAFE_POINT, "stopped by the operator")
            self._say("stopping at the next safe point; ^C again takes the torque away now")
            return
        self._stop_request.ask(StopLevel.TORQUE_OFF, "stopped at once by the operator")
        if self._presses > 2 or not self._stop_request.is_ticking:
            # The loop sees no request: it waits for a person, or hangs in a device. Only an exception gets through.
            raise KeyboardInterrupt

    def from_outside(self, number: int, _frame: FrameType | None) -> None:
        """The system ends the process: the shaft is slowed down, then the motor is disabled."""
        if self._is_closing:
            self._say("the recording is being finished; then the run ends")
            return
        if self._stop_request.is_over:
            return
        self._stop_request.ask(StopLevel.RAMP_DOWN, OUTSIDE[signal.Signals(number)])
        if not self._stop_request.is_ticking:
            raise KeyboardInterrupt

    def _close_first(self) -> None:
        """The motor is off and everything is handed over: the second ^C leaves the rest to `rfca-rig recover`."""
        self._presses += 1
        if self._presses > 1:
            raise KeyboardInterrupt
        self._say("the recording is being finished; ^C again ends here and leaves the rest to rfca-rig recover")


@contextmanager
def handle_signals(stop_request: StopRequest, say: Say) -> Iterator[SignalHandler]:
    """Within the block, signals become stop requests; afterwards the earlier handlers are restored."""
    handler_of_run = SignalHandler(stop_request, say)
    handlers = {signal.SIGINT: handler_of_run.key, **dict.fromkeys(OUTSIDE, handler_of_run.from_outside)}
    # Installed only around the run: elsewhere ^C keeps its usual meaning.
    before = {number: signal.signal(number, handler) for number, handler in handlers.items()}
    try:
        yield handler_of_run
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
