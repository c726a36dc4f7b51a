"""Whether commands keep coming. Times are those at which they were given, not those at which they arrive."""


class Silence:
    """Not armed at first; nothing that moves may pass then. Once too long a silence was seen only a new `arm` lets anything pass."""

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
        """Whether a command may go out. It ends the silence unless that was too long; one that is older than the limit by now may not."""
        if not self.is_armed or given_s - self._since_s > self._limit_s:
            return False
        self._since_s = max(self._since_s, given_s)
        return now_s - given_s <= self._limit_s

    def lasted_s(self, now_s: float) -> float:
        """How long there has been no command."""
        return now_s - self._since_s

    def is_too_long(self, now_s: float) -> bool:
        return self.is_armed and self.lasted_s(now_s) > self._limit_s

    def left_s(self, now_s: float) -> float:
        """Until it is too long; infinite where nothing is armed."""
        return self._since_s + self._limit_s - now_s if self.is_armed else float("inf")
