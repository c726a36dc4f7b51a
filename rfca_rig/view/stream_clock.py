"""Conversion of a device's sample times to the run's clock, while samples arrive."""

from collections import deque

import numpy as np

from rfca_rig.view.decimation import Floats

# Window in s of the smallest delay. Clocks drift apart, so that an old offset is wrong after a while.
REMEMBERED_S = 10.0
# Records overtake each other by less than this; a larger step back means that the device started its clock again.
BACK_S = 0.05
# A jump of the offset by more than this means the same.
LEAP_S = 1.0


class StreamClock:
    """Adds to the device's time the smallest recent difference between arrival and device time.

    A recording does the same with the smallest difference of a whole stage. A restarted stream is recognised by a step of its time.
    """

    def __init__(self) -> None:
        self._minima: deque[tuple[float, float]] = deque()
        self._last_s = -np.inf

    def run_s(self, host_s: Floats, device_s: Floats) -> Floats:
        """Times of samples on the host's clock.

        Parameters
        ----------
        host_s, device_s
            Arrival on the host's clock and time on the device's clock in s, both (m,), m >= 1.

        Returns
        -------
        Floats
            Device times shifted to the host's clock, (m,), in s.
        """
        restarts = np.flatnonzero(np.diff(device_s) < -BACK_S) + 1
        parts = zip(np.split(host_s, restarts), np.split(device_s, restarts), strict=True)
        return np.concatenate([self._of_one_stream(*part) for part in parts])

    def _of_one_stream(self, host_s: Floats, device_s: Floats) -> Floats:
        least_s = float((host_s - device_s).min())
        if device_s[0] < self._last_s - BACK_S or (self._minima and abs(least_s - self._offset_s()) > LEAP_S):
            self._minima.clear()
        self._last_s = float(device_s[-1])
        self._remember(float(host_s[-1]), least_s)
        return device_s + self._offset_s()

    def _offset_s(self) -> float:
        return self._minima[0][1]

    def _remember(self, now_s: float, least_s: float) -> None:
        """Keeps a sliding minimum: offsets ascend in the deque, so that the first is the smallest of the window."""
        while self._minima and self._minima[-1][1] >= least_s:
            self._minima.pop()
        self._minima.append((now_s, least_s))
        while self._minima[0][0] < now_s - REMEMBERED_S:
            self._minima.popleft()
