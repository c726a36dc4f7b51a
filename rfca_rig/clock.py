"""Clocks: real time and simulated time. They are passed in; nothing else in the package sleeps
or reads a clock.
"""

import time
from collections.abc import Callable
from datetime import UTC, datetime, timedelta
from typing import Protocol


class Clock(Protocol):
    """Time source of the engine and the drivers."""

    def now_s(self) -> float:
        """Seconds since the clock was created; never runs backwards."""
        ...

    def start_time(self) -> datetime:
        """Date and time, with time zone, at which `now_s` was zero."""
        ...

    def wall_time(self) -> datetime:
        """Date and time now, with time zone. The system may set it while `now_s` runs on;
        comparing the two shows by how much.
        """
        ...

    def wait_until(self, t_s: float) -> None:
        """Waits until `now_s() >= t_s`; returns at once if that time has passed."""
        ...


class WallClock:
    """Real time, for real devices."""

    def __init__(self) -> None:
        self._started_at = datetime.now(UTC)
        # The monotonic clock is not affected when the system time is set.
        self._zero_s = time.monotonic()

    def now_s(self) -> float:
        return time.monotonic() - self._zero_s

    def start_time(self) -> datetime:
        return self._started_at

    def wall_time(self) -> datetime:
        return datetime.now(UTC)

    def wait_until(self, t_s: float) -> None:
        left_s = t_s - self.now_s()
        if left_s > 0:
            time.sleep(left_s)


# Date and time at which every twin's clock is zero: fixed, so that simulated recordings are
# reproducible.
TWIN_START = datetime(2000, 1, 1, tzinfo=UTC)


class TwinClock:
    """Simulated time: it advances only in `wait_until`, and advances the twins with it.

    A run on this clock never waits for real time, and is reproducible to the last bit.
    """

    def __init__(self) -> None:
        self._now_s = 0.0
        self._worlds: list[Callable[[float], None]] = []

    def carry(self, process: Callable[[float], None]) -> None:
        """Registers a twin: `process(t_s)` is called to advance it to `t_s`."""
        self._worlds.append(process)

    def now_s(self) -> float:
        return self._now_s

    def start_time(self) -> datetime:
        return TWIN_START

    def wall_time(self) -> datetime:
        return self.start_time() + timedelta(seconds=self._now_s)

    def wait_until(self, t_s: float) -> None:
        if t_s > self._now_s:
            self._now_s = t_s
            for process in self._worlds:
                process(t_s)


# Lag in s that a delayed simulation makes up by running faster; a larger one stays.
MAX_CATCH_UP_S = 0.1


class WatchedTwinClock(TwinClock):
    """`TwinClock` for a live view: rig time passes at no more than `pace` times real time. The
    results are the same to the last bit.
    """

    def __init__(self, pace: float = 1.0) -> None:
        super().__init__()
        self._pace = pace
        self._wall = WallClock()
        self._behind_s = 0.0

    def wait_until(self, t_s: float) -> None:
        """Advances, then waits for real time. A delayed simulation makes up at most 0.1 s, and
        stays late by the rest.
        """
        super().wait_until(t_s)
        due_s = t_s / self._pace
        self._behind_s = max(self._behind_s, self._wall.now_s() - due_s - MAX_CATCH_UP_S)
        self._wall.wait_until(due_s + self._behind_s)
