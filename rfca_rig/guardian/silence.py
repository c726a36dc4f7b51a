"""Command timeout of the guardian. Times are those when commands were given, not when they arrived."""


class CommandTimeout:
    """Timeout state. Until it is armed, and after a silence that was too long, no command that moves the drive may pass."""

    def __init__(self, limit_s: float) -> None:
        self._limit_s = limit_s
        self._since_s = 0.0
        self.is_armed = False

    def arm(self, t_s: float) -> None:
        self._since_s = t_s
        self.is_armed = True

    def disarm(self) -> None:
        self.is_armed = False

    def may_pass(self, given_s: float, now_s: float) -> bool:
        """Whether a command may pass. It restarts the timeout unless that has expired; one older than the limit by now may not pass."""
        # Judged by when it was given: a late guardian must not let pass what came after a real silence.
        if not self.is_armed or given_s - self._since_s > self._limit_s:
            return False
        self._since_s = max(self._since_s, given_s)
        return now_s - given_s <= self._limit_s

    def lasted_s(self, now_s: float) -> float:
        """Time in s since the last command."""
        return now_s - self._since_s

    def has_expired(self, now_s: float) -> bool:
        return self.is_armed and self.lasted_s(now_s) > self._limit_s

    def remaining_s(self, now_s: float) -> float:
        """Time in s until the timeout expires; infinite if it is not armed."""
        return self._since_s + self._limit_s - now_s if self.is_armed else float("inf")
