"""Consistency check of reported speed and angle: a difference shows a wrong scale in the settings."""

# Length of a window, and the longest gap between two reports over which the trapezoidal rule is used, in s.
WINDOW_S = 0.2
MAX_GAP_S = 0.02
# Least rotation in a window. With less, the resolution of the speed field dominates.
MIN_ROTATION_RAD = 0.1
# Relative difference, and the number of windows in a row that must show it.
MAX_RELATIVE_DIFFERENCE = 0.25
WINDOWS = 3


class SpeedCheck:
    """Compares the integral of the reported speed with the change of the reported angle, window by window.

    `fault` gives the factor between them, once three windows in a row with motion differ by more than a quarter. `scales` names the
    settings to check.
    """

    def __init__(self, scales: str) -> None:
        self._scales = scales
        self.fault: str | None = None
        self.forgive()

    def forgive(self) -> None:
        """Clears the fault and starts a new window."""
        self.fault = None
        self._last: tuple[float, float, float] | None = None
        self._apart = 0
        self._open()

    def _open(self) -> None:
        self._elapsed_s = self._turned_rad = self._integral_rad = 0.0

    def follow(self, t_s: float, angle_rad: float, speed_rad_s: float) -> None:
        """Takes in one report, later than the last."""
        before, self._last = self._last, (t_s, angle_rad, speed_rad_s)
        if before is None or t_s - before[0] > MAX_GAP_S:
            self._open()
            return
        elapsed_s = t_s - before[0]
        self._elapsed_s += elapsed_s
        self._turned_rad += angle_rad - before[1]
        self._integral_rad += 0.5 * (speed_rad_s + before[2]) * elapsed_s
        if self._elapsed_s >= WINDOW_S:
            self._judge()
            self._open()

    def _judge(self) -> None:
        most_rad = max(abs(self._turned_rad), abs(self._integral_rad))
        if most_rad < MIN_ROTATION_RAD:
            return
        self._apart = self._apart + 1 if abs(self._turned_rad - self._integral_rad) > MAX_RELATIVE_DIFFERENCE * most_rad else 0
        if self._apart >= WINDOWS:
            factor = self._integral_rad / self._turned_rad if self._turned_rad else float("inf")
            self.fault = f"the speed that the drive reports is {factor:.2g} times that of its angle; check {self._scales}"
