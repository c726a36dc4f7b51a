"""A position that went further between two reports than a shaft can turn: the drive restarted, was zeroed, or its encoder slipped."""

LEAP_RAD = 0.1
SPARE = 1.5
MOST_RAD_S2 = 5000.0  # 40 N m on a bare rotor of 0.008 kg m2
MOST_RAD_S = 60.0


class LeapWatch:
    """Follows position and speed of the shaft. `fault` stays once there was a leap: the zero is lost with it.

    Between two reports the shaft may go as far as the faster of their two speeds takes it, half as much again, and what the
    strongest acceleration adds; 0.1 rad more is a leap. The time between two is the device's, or that of the host between two
    looks where it is longer, so that lost reports are no leap.
    """

    def __init__(self) -> None:
        self.fault: str | None = None
        self._last: tuple[float, float, float, float] | None = None

    def follow(self, host_s: float, device_s: float, angle_rad: float, speed_rad_s: float, judged: bool = True) -> None:
        """One report, later than the one before, taken in by the host at `host_s`; not `judged`, it may follow on any other."""
        last, self._last = self._last, (host_s, device_s, angle_rad, abs(speed_rad_s))
        if last is None or self.fault is not None or not judged:
            return
        elapsed_s = max(host_s - last[0], device_s - last[1])
        fastest_rad_s = max(last[3], abs(speed_rad_s)) * SPARE + 0.5 * MOST_RAD_S2 * elapsed_s
        by_rad = angle_rad - last[2]
        if abs(by_rad) > LEAP_RAD + min(fastest_rad_s, MOST_RAD_S) * elapsed_s:
            self.fault = (
                f"position leapt by {by_rad:.2f} rad within {1e3 * elapsed_s:.1f} ms, more than the shaft can turn; "
                "the drive restarted, was zeroed, or its encoder slipped: find its zero again"
            )
