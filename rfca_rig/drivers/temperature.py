"""Temperature telemetry of a drive that sends it in separate messages."""

from math import isfinite

# Time without a temperature until it is a fault. Overheating takes longer than this.
MAX_SILENCE_S = 10.0


class TemperatureTelemetry:
    """`warmest_C` is the highest temperature of the last message.

    It is None before the first message, and if no value is finite, as without a thermistor.
    """

    def __init__(self) -> None:
        self.warmest_C: float | None = None
        self._told_s = 0.0

    def hear(self, now_s: float, *values_C: float) -> None:
        """Takes in one message, received at host time `now_s`."""
        self.warmest_C = max((value for value in values_C if isfinite(value)), default=None)
        self._told_s = now_s

    def fault(self, now_s: float) -> str | None:
        """Set if temperatures that were reported have stopped: a limit on them would no longer protect the motor."""
        if self.warmest_C is None or now_s - self._told_s <= MAX_SILENCE_S:
            return None
        return f"no temperature for {now_s - self._told_s:.0f} s, though the drive told it before; check its temperature_msg_rate_ms"
