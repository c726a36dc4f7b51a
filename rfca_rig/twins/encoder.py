"""Encoder of a drive, as seen in its reports; the drive's control loop uses the true motion."""


class Encoder:
    """Reports the true motion until it is frozen."""

    def __init__(self) -> None:
        self._stands = False
        self._standing: tuple[float, float] | None = None

    def freeze(self) -> None:
        """Fault: every later report repeats the angle and speed of the next one."""
        self._stands = True

    def told(self, angle: float, speed: float) -> tuple[float, float]:
        """Angle and speed as reported, in the units of the arguments."""
        if self._stands and self._standing is None:
            self._standing = angle, speed
        return self._standing or (angle, speed)
