"""Twins carried along by a real clock: one loop, one thread."""

from collections.abc import Callable, Sequence

from rfca_rig.clock import Clock
from rfca_rig.twin_server.port import Port

PERIOD_S = 1e-3
LONGEST_LEAP_S = 0.05


class RealTimeLoop:
    """Every millisecond: the ports take in, `process` brings the twins to now, beginning at 0, and the ports give out.

    Twins that the machine cannot carry fast enough lose time instead of falling further behind: a leap is at most 50 ms, and
    what goes beyond is added to `slipped_s`. To their clients they then run slow, as a device with a bad crystal does.
    """

    def __init__(self, process: Callable[[float], None], clock: Clock) -> None:
        self._process = process
        self._clock = clock
        self._twins_s = 0.0
        self.slipped_s = 0.0

    def status(self) -> str:
        """One line."""
        return f"running for {self._twins_s:.2f} s of the twins' time, {self.slipped_s:.2f} s behind the clock"

    def run(self, ports: Sequence[Port], step: Callable[[float], None], seconds: float) -> None:
        """Goes on for that long from now, once only; `step(running_s)` is called in every round, and may end the loop by raising."""
        began_s = due_s = self._clock.now_s()
        while (now_s := self._clock.now_s()) < began_s + seconds:
            step(now_s - began_s)
            _poll(ports, now_s)
            self._carry(now_s - began_s)
            _poll(ports, now_s)
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
