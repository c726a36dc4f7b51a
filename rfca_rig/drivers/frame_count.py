"""Device time from counting frames that are sent at a fixed period."""

from math import inf

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]


class FrameCount:
    """Converts batches of periodic frames to device time, 0 at the first frame.

    The frames carry no number, so a loss shows only as a growing lag behind the host clock. The newest frame of a drained batch is
    at most one period plus the transmission time old, however late the host reads. A lag that exceeds the smallest one so far by
    more than 10 ms and three periods is therefore loss. The count then jumps by whole periods, before the batch. The smallest lag may
    rise by `DRIFT`, as two crystals differ; losses of a few frames are corrected once they have added up.

    `fault` is set if there are more frames than the host clock allows in two windows of 0.5 s in a row. They are then duplicated, or
    come at another rate. Frames that piled up during a long pause affect only one window.
    """

    # Relative clock drift allowed between device and host: 200 ppm.
    DRIFT = 2e-4
    WINDOW_S = 0.5
    # Ratio of counted to expected frames from which a window has too many.
    TOO_MANY = 1.2

    def __init__(self, period_s: float) -> None:
        self._period_s = period_s
        self._loss_s = max(0.01, 3.0 * period_s)
        self._next = 0
        self._least_lag_s = inf
        self._seen_s = 0.0
        self._window: tuple[float, int] | None = None
        self._had_too_many = False
        self.lost = 0
        self.fault: str | None = None

    def stamp(self, frames: int, now_s: float) -> Floats:
        """Device times (frames,) in s of a batch that was drained at host time `now_s`."""
        self._count_up(frames, now_s)
        if frames:
            self._follow(now_s, (self._next + frames - 1) * self._period_s)
        stamps = np.arange(self._next, self._next + frames, dtype=np.float64)
        self._next += frames
        return stamps * self._period_s

    def _count_up(self, frames: int, now_s: float) -> None:
        """Compares the number of frames in a window with the length of the window."""
        # The first batch may have piled up before, so it only opens the window.
        began_s, counted = self._window or (now_s, -frames)
        self._window = began_s, counted + frames
        elapsed_s = now_s - began_s
        if elapsed_s < self.WINDOW_S:
            return
        self._window = now_s, 0
        # 0.1 s on top allows for frames that an adapter holds back and delivers late.
        had_too_many, self._had_too_many = self._had_too_many, (counted + frames) * self._period_s > self.TOO_MANY * elapsed_s + 0.1
        if had_too_many and self._had_too_many:
            rate_Hz = (counted + frames) / elapsed_s
            self.fault = (
                f"its reports come {rate_Hz:.0f} times a second where {1.0 / self._period_s:.0f} are set; "
                "are frames doubled on the way, or was their period changed?"
            )

    def _follow(self, now_s: float, newest_s: float) -> None:
        lag_s = now_s - newest_s
        crept_s = self._least_lag_s + self.DRIFT * (now_s - self._seen_s)
        self._seen_s = now_s
        excess_s = lag_s - crept_s
        if self._next > 0 and excess_s > self._loss_s:
            # Rounded down but for a quarter period, which is left to clock drift in the meantime.
            jump = int(excess_s / self._period_s + 0.25)
            self._next += jump
            self.lost += jump
            lag_s -= jump * self._period_s
        self._least_lag_s = min(lag_s, crept_s)
