"""A device's samples on the run's own clock, while they come."""

from collections import deque

import numpy as np

from rfca_rig.view.decimation import Floats

REMEMBERED_S = 10.0
BACK_S = 0.05  # records overtake each other by less
LEAP_S = 1.0


class StreamClock:
    """Adds to the device's time the least delay of arrival seen lately, as a recording does with the least of its whole stage.

    Lately, because clocks drift apart. A stream that was started anew is known by its time going back, or leaping.
    """

    def __init__(self) -> None:
        self._least: deque[tuple[float, float]] = deque()
        self._last_s = -np.inf

    def run_s(self, host_s: Floats, device_s: Floats) -> Floats:
        """The times (m,) of samples, at least one, on the host's clock."""
        anew = np.flatnonzero(np.diff(device_s) < -BACK_S) + 1
        parts = zip(np.split(host_s, anew), np.split(device_s, anew), strict=True)
        return np.concatenate([self._of_one_stream(*part) for part in parts])

    def _of_one_stream(self, host_s: Floats, device_s: Floats) -> Floats:
        least_s = float((host_s - device_s).min())
        if device_s[0] < self._last_s - BACK_S or (self._least and abs(least_s - self._offset_s()) > LEAP_S):
            self._least.clear()
        self._last_s = float(device_s[-1])
        self._remember(float(host_s[-1]), least_s)
        return device_s + self._offset_s()

    def _offset_s(self) -> float:
        return self._least[0][1]

    def _remember(self, now_s: float, least_s: float) -> None:
        """The first is the least of all; each that follows the least of those after it."""
        while self._least and self._least[-1][1] >= least_s:
            self._least.pop()
        self._least.append((now_s, least_s))
        while self._least[0][0] < now_s - REMEMBERED_S:
            self._least.popleft()
