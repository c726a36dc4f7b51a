"""Unwrapping of a 16 bit position, with detection of jumps and of a position stuck at the end of its range."""

CODES = 1 << 16
# A code at the end of its range for longer than STUCK_S, at a reported speed above MIN_SPEED_RAD_S, is stuck.
STUCK_S = 0.05
MIN_SPEED_RAD_S = 0.5


class WrappedPosition:
    """Unwraps a code that wraps every 65 536 counts: between two codes the shaft took the shorter way.

    This holds while it turns less than half the span between two reports. Some firmware stops the code at the end of its range
    instead. The code then stands still although the drive reports a speed, and the angle is lost. `ends` are the codes where this
    can happen. `fault` reports this, or a jump larger than any motion: a restart, a new zero, or an encoder slip. A jump is never
    cleared, as the zero is lost with it.
    """

    def __init__(self, ends: frozenset[int], most_counts_s: float, margin_counts: float) -> None:
        self._ends = ends
        self._most_counts_s = most_counts_s
        self._margin_counts = margin_counts
        self._last: tuple[float, int] | None = None
        self._stuck_from_s: float | None = None
        self._count: int | None = None
        self._stuck: str | None = None
        self.leap: str | None = None

    @property
    def fault(self) -> str | None:
        return self.leap or self._stuck

    def forgive(self) -> None:
        """Clears the stuck fault and the last report; the turn count stays."""
        self._stuck = None
        self._last = self._stuck_from_s = None

    def follow(self, code: int, t_s: float, speed_rad_s: float, judged: bool = True) -> int:
        """The unwrapped code, counted from the first one. With `judged` False no jump is looked for at this step."""
        before = code if self._count is None else self._count
        # Signed difference in -32768..32767, the shorter way around.
        step = (code - before + CODES // 2) % CODES - CODES // 2
        self._count = before + step
        if self._last is not None and judged:
            self._look_for_leap(step, t_s - self._last[0])
        self._look_for_end(code, t_s, speed_rad_s)
        self._last = t_s, code
        return self._count

    def _look_for_leap(self, step: int, elapsed_s: float) -> None:
        farthest = self._most_counts_s * elapsed_s + self._margin_counts
        # After a long gap the shaft could have gone half the span, so a jump cannot be distinguished from motion.
        if farthest < CODES // 2 and abs(step) > farthest:
            self.leap = (
                f"position leapt by {step} counts within {1e3 * elapsed_s:.1f} ms, more than the drive can turn; "
                "it restarted, was zeroed, or its encoder slipped: find its zero again"
            )

    def _look_for_end(self, code: int, t_s: float, speed_rad_s: float) -> None:
        if code not in self._ends or abs(speed_rad_s) < MIN_SPEED_RAD_S or (self._last is not None and self._last[1] != code):
            self._stuck_from_s = None
        elif self._stuck_from_s is None:
            self._stuck_from_s = t_s
        elif t_s - self._stuck_from_s > STUCK_S:
            self._stuck = (
                f"position stands at the end of its range (code {code}) while the shaft turns: this firmware does not count on; "
                "turn the shaft back, and restart the drive near its zero"
            )
