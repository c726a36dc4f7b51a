"""Time is passed in. Nothing else in the package sleeps or reads a clock."""

import time
from collections.abc import Callable
from datetime import UTC, datetime, timedelta
from typing import Protocol


class Clock(Protocol):
    """What the engine and the drivers wait on."""

    def now_s(self) -> float:
        """Seconds since the clock was made; never runs backwards."""
        ...

    def started_at(self) -> datetime:
        """The moment, with time zone, at which `now_s` was zero."""
        ...

    def wall_time(self) -> datetime:
        """What a clock on the wall shows now, with time zone. It may be set while `now_s` goes on: together they tell by how much."""
        ...

    def wait_until(self, t_s: float) -> None:
        """Returns at `now_s() >= t_s`; at once where that has passed."""
        ...


class WallClock:
    """Real time, for real devices."""

    def __init__(self) -> None:
        self._started_at = datetime.now(UTC)
        self._zero_s = time.monotonic()

    def now_s(self) -> float:
        return time.monotonic() - self._zero_s

    def started_at(self) -> datetime:
        return self._started_at

    def wall_time(self) -> datetime:
        return datetime.now(UTC)

    def wait_until(self, t_s: float) -> None:
        left_s = t_s - self.now_s()
        if left_s > 0:
            time.sleep(left_s)


class TwinClock:
    """Time of a simulated rig: passes only while somebody waits, and carries the twins along.

    A run on it never waits for the wall clock and is the same to the last bit every time.
    """

    def __init__(self) -> None:
        self._now_s = 0.0
        self._worlds: list[Callable[[float], None]] = []

    def carry(self, process: Callable[[float], None]) -> None:
        """`process(t_s)` is called to bring a twin from where it was to `t_s`."""
        self._worlds.append(process)

    def now_s(self) -> float:
        return self._now_s

    def started_at(self) -> datetime:
        return datetime(2000, 1, 1, tzinfo=UTC)

    def wall_time(self) -> datetime:
        return self.started_at() + timedelta(seconds=self._now_s)

    def wait_until(self, t_s: float) -> None:
        if t_s > self._now_s:
            self._now_s = t_s
            for process in self._worlds:
                process(t_s)


HURRIES_S = 0.1


class WatchedTwinClock(TwinClock):
    """The same for somebody who looks on: rig time passes at `pace` times real time at most. What happens is the same to the last bit."""

    def __init__(self, pace: float = 1.0) -> None:
        super().__init__()
        self._pace = pace
        self._wall = WallClock()
        self._behind_s = 0.0

    def wait_until(self, t_s: float) -> None:
        """A simulation that was held up hurries for at most a blink afterwards, and is late for good by the rest."""
        super().wait_until(t_s)
        due_s = t_s / self._pace
        self._behind_s = max(self._behind_s, self._wall.now_s() - due_s - HURRIES_S)
        self._wall.wait_until(due_s + self._behind_s)
