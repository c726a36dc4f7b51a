"""A position sent in 16 bits, counted on over its wraps; and what can go wrong with it."""

CODES = 1 << 16
STUCK_S = 0.05
TURNING_RAD_S = 0.5


class WrappedPosition:
    """Follows a code that wraps every 65 536 counts: between two codes the shaft has gone the shorter way.

    That holds while it turns less than half the span between two reports. Some firmware stops the code at the end of its range
    instead; then it stands still there although the drive reports a speed, and the angle is lost. `ends` are the codes where
    that may happen. `fault` says so, or that the position leapt further than any motion: a restart, a new zero, an encoder slip.
    A leap is never forgiven, as the zero is lost with it.
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
        """Forgets that the position stood at its end, and that time has passed; turns stay counted."""
        self._stuck = None
        self._last = self._stuck_from_s = None

    def follow(self, code: int, t_s: float, speed_rad_s: float, judged: bool = True) -> int:
        """The code with all turns since the first, which counts as it is. Not `judged`, it may follow on any other."""
        before = code if self._count is None else self._count
        step = (code - before + CODES // 2) % CODES - CODES // 2
        self._count = before + step
        if self._last is not None and judged:
            self._look_for_leap(step, t_s - self._last[0])
        self._look_for_end(code, t_s, speed_rad_s)
        self._last = t_s, code
        return self._count

    def _look_for_leap(self, step: int, elapsed_s: float) -> None:
        farthest = self._most_counts_s * elapsed_s + self._margin_counts
        if farthest < CODES // 2 and abs(step) > farthest:
            self.leap = (
                f"position leapt by {step} counts within {1e3 * elapsed_s:.1f} ms, more than the drive can turn; "
                "it restarted, was zeroed, or its encoder slipped: find its zero again"
            )

    def _look_for_end(self, code: int, t_s: float, speed_rad_s: float) -> None:
        if code not in self._ends or abs(speed_rad_s) < TURNING_RAD_S or (self._last is not None and self._last[1] != code):
            self._stuck_from_s = None
        elif self._stuck_from_s is None:
            self._stuck_from_s = t_s
        elif t_s - self._stuck_from_s > STUCK_S:
            self._stuck = (
                f"position stands at the end of its range (code {code}) while the shaft turns: this firmware does not count on; "
                "turn the shaft back, and restart the drive near its zero"
            )
