"""Device time of records without a time stamp: by counting frames of a fixed period, or from a
millisecond counter.

A wrong period would stretch the time base of a whole recording, so it is checked.
"""

from collections.abc import Callable
from math import inf

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

COUNT_S = 1e-3
WRAP = 1 << 32

PERIODS_PER_ATTEMPT = 20
# One measurement may be wrong, if reports or this program were delayed. A wrong setting is wrong
# every time.
MAX_ATTEMPTS = 3
# Factor between measured and configured period from which the setting is refused.
MAX_PERIOD_RATIO = 2.0


class FrameCount:
    """Converts batches of periodic frames to device time, 0 at the first frame.

    The frames carry no number, so a loss shows only as a growing lag behind the host clock. The
    newest frame of a drained batch is at most one period plus the transmission time old, however
    late the host reads. A lag that exceeds the smallest one so far by more than 10 ms and three
    periods is therefore loss. The count then jumps by whole periods, before the batch. The smallest
    lag may rise by `DRIFT`, as two crystals differ; losses of a few frames are corrected once they
    have added up.

    `fault` is set if there are more frames than the host clock allows in two windows of 0.5 s in a
    row. They are then duplicated, or come at another rate. Frames that piled up during a long pause
    affect only one window.
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
        first = self._number(frames, now_s)
        return np.arange(first, first + frames, dtype=np.float64) * self._period_s

    def list_stamps(self, frames: int, now_s: float) -> list[float]:
        """The same as plain numbers: for one or two, an array takes longer."""
        first = self._number(frames, now_s)
        return [number * self._period_s for number in range(first, first + frames)]

    def _number(self, frames: int, now_s: float) -> int:
        """Counts a batch; returns the number of its first frame."""
        self._count_up(frames, now_s)
        if frames:
            self._follow(now_s, (self._next + frames - 1) * self._period_s)
        self._next += frames
        return self._next - frames

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
        had_too_many = self._had_too_many
        self._had_too_many = (counted + frames) * self._period_s > self.TOO_MANY * elapsed_s + 0.1
        if had_too_many and self._had_too_many:
            rate_Hz = (counted + frames) / elapsed_s
            self.fault = (
                f"its reports come {rate_Hz:.0f} times a second where "
                f"{1.0 / self._period_s:.0f} are set; "
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


class CounterClock:
    """Times of answers in device time, 0 at the first.

    The counter gives the device millisecond of an answer. The host time of the query, plus an
    offset, gives the position within it; the offset is moved only as far as the counter requires. A
    late wake-up of the host therefore shifts a time by less than one count, and drifting clocks
    never disagree by more than one.
    """

    def __init__(self) -> None:
        self._counter: int | None = None
        # Counts since the first answer.
        self._elapsed = 0
        self._offset_s = 0.0
        self._stamped_s = 0.0
        self.restarts = 0

    def predict_time_s(self, asked_s: float) -> float:
        """Predicted device time in s of an answer to a query sent at `asked_s`, before its
        counter is known.
        """
        return asked_s + self._offset_s

    def distance_s(self, counter: int, asked_s: float) -> float:
        """Time in s between the counter of an answer and the prediction for a query at
        `asked_s`; 0 before the first answer.
        """
        if self._counter is None:
            return 0.0
        return abs(
            (self._elapsed + wrap_to_signed(counter - self._counter)) * COUNT_S
            - self.predict_time_s(asked_s)
        )

    def stamp(self, counter: int, asked_s: float) -> float:
        """Device time in s of the answer with this counter to a query at host time `asked_s`.
        Never decreases.
        """
        if self._counter is None:
            self._offset_s = -asked_s
        else:
            self._elapsed += self._counts_since(counter, asked_s)
        self._counter = counter
        middle_s = self._elapsed * COUNT_S
        free_s = self.predict_time_s(asked_s)
        # The prediction is clipped to the millisecond that the counter allows.
        stamp_s = min(max(free_s, middle_s - 0.5 * COUNT_S), middle_s + 0.5 * COUNT_S)
        # Follows slow clock drift; jitter of the host stays inside the count and leaves the offset
        # alone.
        self._offset_s += stamp_s - free_s
        self._stamped_s = max(self._stamped_s, stamp_s)
        return self._stamped_s

    def _counts_since(self, counter: int, asked_s: float) -> int:
        """Counts since the last answer. A counter that ran backwards means a restart; the host
        clock then bridges the gap.
        """
        counts = wrap_to_signed(counter - (self._counter or 0))
        if counts >= 0:
            return counts
        self.restarts += 1
        return max(0, round(self.predict_time_s(asked_s) / COUNT_S) - self._elapsed)


def wrap_to_signed(difference: int) -> int:
    """Difference of two 32 bit counters, of either sign."""
    return (difference + WRAP // 2) % WRAP - WRAP // 2


def find_wrong_period(look_s: Callable[[], float], set_s: float) -> float | None:
    """The measured report period in s if it differs from `set_s` by a factor of two, None if it
    agrees.

    `look_s` watches `PERIODS_PER_ATTEMPT` periods and returns the mean one. The period is wrong
    only if every measurement says so.
    """
    measured_s = set_s
    for _ in range(MAX_ATTEMPTS):
        measured_s = look_s()
        if set_s / MAX_PERIOD_RATIO < measured_s < set_s * MAX_PERIOD_RATIO:
            return None
    return measured_s
