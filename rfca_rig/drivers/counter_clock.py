"""Device time from a millisecond counter that comes with each answer."""

COUNT_S = 1e-3
WRAP = 1 << 32


class CounterClock:
    """Times of answers in device time, 0 at the first.

    The counter gives the device millisecond of an answer. The host time of the query, plus an offset, gives the position within it;
    the offset is moved only as far as the counter requires. A late wake-up of the host therefore shifts a time by less than one
    count, and drifting clocks never disagree by more than one.
    """

    def __init__(self) -> None:
        self._counter: int | None = None
        # Counts since the first answer.
        self._elapsed = 0
        self._offset_s = 0.0
        self._stamped_s = 0.0
        self.restarts = 0

    def predicted(self, asked_s: float) -> float:
        """Predicted device time in s of an answer to a query sent at `asked_s`, before its counter is known."""
        return asked_s + self._offset_s

    def distance_s(self, counter: int, asked_s: float) -> float:
        """Time in s between the counter of an answer and the prediction for a query at `asked_s`; 0 before the first answer."""
        if self._counter is None:
            return 0.0
        return abs((self._elapsed + _signed_difference(counter - self._counter)) * COUNT_S - self.predicted(asked_s))

    def stamp(self, counter: int, asked_s: float) -> float:
        """Device time in s of the answer with this counter to a query at host time `asked_s`. Never decreases."""
        if self._counter is None:
            self._offset_s = -asked_s
        else:
            self._elapsed += self._counts_since(counter, asked_s)
        self._counter = counter
        middle_s = self._elapsed * COUNT_S
        free_s = self.predicted(asked_s)
        # The prediction is clipped to the millisecond that the counter allows.
        stamp_s = min(max(free_s, middle_s - 0.5 * COUNT_S), middle_s + 0.5 * COUNT_S)
        # Follows slow clock drift; jitter of the host stays inside the count and leaves the offset alone.
        self._offset_s += stamp_s - free_s
        self._stamped_s = max(self._stamped_s, stamp_s)
        return self._stamped_s

    def _counts_since(self, counter: int, asked_s: float) -> int:
        """Counts since the last answer. A counter that ran backwards means a restart; the host clock then bridges the gap."""
        counts = _signed_difference(counter - (self._counter or 0))
        if counts >= 0:
            return counts
        self.restarts += 1
        return max(0, round(self.predicted(asked_s) / COUNT_S) - self._elapsed)


def _signed_difference(difference: int) -> int:
    """Signed difference of two 32 bit counters."""
    return (difference + WRAP // 2) % WRAP - WRAP // 2
