"""What a drive's encoder makes of the shaft's motion, for the drive's reports; its loop goes by the motion itself."""


class Encoder:
    """Tells the motion as it is, until it is told to stand still."""

    def __init__(self) -> None:
        self._stands = False
        self._standing: tuple[float, float] | None = None

    def freeze(self) -> None:
        """Every report from now on is the next one over again: angle and speed."""
        self._stands = True

    def told(self, angle: float, speed: float) -> tuple[float, float]:
        """Angle and speed as reported, in whatever units they come."""
        if self._stands and self._standing is None:
            self._standing = angle, speed
        return self._standing or (angle, speed)
