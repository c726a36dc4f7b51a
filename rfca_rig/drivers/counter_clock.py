"""A device's own time, from a millisecond counter that comes with each answer."""

COUNT_S = 1e-3
WRAP = 1 << 32


class CounterClock:
    """Moments of answers in device time, 0 at the first.

    The counter says in which millisecond of the device an answer was made; where within it, the moment of asking by the host's
    clock does, after an offset that is moved only as far as the counter demands. So a late wake-up of the host shifts a moment by
    less than a count, and clocks that creep apart never disagree by more than one.
    """

    def __init__(self) -> None:
        self._counter: int | None = None
        self._elapsed = 0  # counts since the first answer
        self._offset_s = 0.0
        self._stamped_s = 0.0
        self.restarts = 0

    def predicted(self, asked_s: float) -> float:
        """Device time of an answer to a question of `asked_s`, before the counter is known."""
        return asked_s + self._offset_s

    def distance_s(self, counter: int, asked_s: float) -> float:
        """How far the answer with this counter is from one to a question of `asked_s`; 0 before the first answer."""
        if self._counter is None:
            return 0.0
        return abs((self._elapsed + _signed(counter - self._counter)) * COUNT_S - self.predicted(asked_s))

    def stamp(self, counter: int, asked_s: float) -> float:
        """Device time of the answer with this counter to a question of host time `asked_s`. Never runs backwards."""
        if self._counter is None:
            self._offset_s = -asked_s
        else:
            self._elapsed += self._counts_since(counter, asked_s)
        self._counter = counter
        middle_s = self._elapsed * COUNT_S
        free_s = self.predicted(asked_s)
        stamp_s = min(max(free_s, middle_s - 0.5 * COUNT_S), middle_s + 0.5 * COUNT_S)
        self._offset_s += stamp_s - free_s
        self._stamped_s = max(self._stamped_s, stamp_s)
        return self._stamped_s

    def _counts_since(self, counter: int, asked_s: float) -> int:
        """A counter that ran back belongs to a device that started anew; the host's clock bridges the gap."""
        counts = _signed(counter - (self._counter or 0))
        if counts >= 0:
            return counts
        self.restarts += 1
        return max(0, round(self.predicted(asked_s) / COUNT_S) - self._elapsed)


def _signed(difference: int) -> int:
    """A difference of two 32 bit counters, with sign."""
    return (difference + WRAP // 2) % WRAP - WRAP // 2
