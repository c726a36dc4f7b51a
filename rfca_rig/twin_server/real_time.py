"""Real-time loop for the twins, in one thread."""

from collections.abc import Callable, Sequence
from typing import Protocol

from rfca_rig.clock import Clock

# Period of the loop, and longest step of the twins after a delay, in s.
PERIOD_S = 1e-3
LONGEST_LEAP_S = 0.05


class Port(Protocol):
    """A port to the outside. It never waits; the server polls it before and after each step of the twins."""

    def address(self) -> str:
        """Address of the port, as shown to the user."""
        ...

    def poll(self, now_s: float) -> None:
        """Receives what has arrived, sends what is queued. `now_s` is the server's clock."""
        ...

    def close(self) -> None:
        """Closes the port. May be called any number of times."""
        ...


class RealTimeLoop:
    """Every millisecond the ports receive, `process` advances the twins to now, starting at 0, and the ports send.

    If the machine is too slow, the twins lose time instead of falling further behind. A step is at most 50 ms, and the excess is added
    to `slipped_s`. To their clients they then seem slow, like a device with a bad crystal.
    """

    def __init__(self, process: Callable[[float], None], clock: Clock) -> None:
        self._process = process
        self._clock = clock
        self._twins_s = 0.0
        self.slipped_s = 0.0

    def status(self) -> str:
        """State of the loop in one line."""
        return f"running for {self._twins_s:.2f} s of the twins' time, {self.slipped_s:.2f} s behind the clock"

    def run(self, ports: Sequence[Port], step: Callable[[float], None], seconds: float) -> None:
        """Runs for `seconds`; call it once only. `step(running_s)` is called in every cycle, and may end the loop by raising."""
        began_s = due_s = self._clock.now_s()
        while (now_s := self._clock.now_s()) < began_s + seconds:
            step(now_s - began_s)
            _poll(ports, now_s)
            self._carry(now_s - began_s)
            _poll(ports, now_s)
            # After a delay the loop does not make up the missed cycles.
            due_s = max(due_s + PERIOD_S, self._clock.now_s())
            self._clock.wait_until(due_s)

    def _carry(self, running_s: float) -> None:
        to_s = running_s - self.slipped_s
        late_s = to_s - self._twins_s - LONGEST_LEAP_S
        if late_s > 0.0:
            self.slipped_s += late_s
            to_s -= late_s
        if to_s > self._twins_s:
            self._process(to_s)
            self._twins_s = to_s


def _poll(ports: Sequence[Port], now_s: float) -> None:
    for port in ports:
        port.poll(now_s)
