"""Time that a search may take. It then ends with the best answer so far."""

from dataclasses import dataclass

from rfca_rig.clock import Clock


@dataclass(frozen=True)
class TimeBudget:
    """A search begins nothing more from `ends_at_s` of the clock on; without a clock it never ends
    early.
    """

    clock: Clock | None = None
    ends_at_s: float = 0.0

    @property
    def is_spent(self) -> bool:
        """Whether the time is up."""
        return self.clock is not None and self.clock.now_s() >= self.ends_at_s


UNLIMITED = TimeBudget()


def allow_minutes(clock: Clock, minutes: float | None) -> TimeBudget:
    """The budget of so many minutes from now on; no limit for None."""
    if minutes is None:
        return UNLIMITED
    return TimeBudget(clock, clock.now_s() + 60.0 * minutes)
