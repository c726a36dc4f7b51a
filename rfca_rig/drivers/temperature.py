"""What a drive tells of its temperatures, where it sends them apart from everything else."""

from math import isfinite

GONE_S = 10.0  # heat takes longer to do harm


class ToldTemperature:
    """`warmest_C` of the last message; None before the first, and where none of its values is a number, as without a thermistor."""

    def __init__(self) -> None:
        self.warmest_C: float | None = None
        self._told_s = 0.0

    def hear(self, now_s: float, *values_C: float) -> None:
        """One message, heard at host time `now_s`."""
        self.warmest_C = max((value for value in values_C if isfinite(value)), default=None)
        self._told_s = now_s

    def fault(self, now_s: float) -> str | None:
        """That a temperature which was told is told no more: a limit on it would guard nothing."""
        if self.warmest_C is None or now_s - self._told_s <= GONE_S:
            return None
        return f"no temperature for {now_s - self._told_s:.0f} s, though the drive told it before; check its temperature_msg_rate_ms"
