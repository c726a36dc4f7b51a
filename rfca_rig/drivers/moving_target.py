"""Where the shaft should be while a speed is commanded, for drives whose own loop has no memory."""


class MovingTarget:
    """Turns angle errors into speed: demanded speed = commanded speed + gain * (target - angle).

    Under a commanded speed the target moves along with it, so what a load holds the shaft back is made up for: together with a
    drive that gives torque in proportion to speed error this is a speed loop with an integrator. The target never gets further
    from the shaft than `most_behind_rad`, where the drive gives all it has: nothing winds up.
    """

    def __init__(self, gain_per_s: float, most_behind_rad: float, angle_rad: float, now_s: float) -> None:
        self._gain_per_s = gain_per_s
        self._most_behind_rad = most_behind_rad
        self._target_rad = angle_rad
        self._speed_rad_s = 0.0
        self._since_s = now_s

    def speed_to_angle(self, target_rad: float, speed_rad_s: float, angle_rad: float, now_s: float) -> float:
        """The speed that leads to an angle moving at `speed_rad_s`, with the shaft at `angle_rad` now."""
        self._target_rad, self._speed_rad_s, self._since_s = target_rad, speed_rad_s, now_s
        return speed_rad_s + self._gain_per_s * (target_rad - angle_rad)

    def speed_for(self, speed_rad_s: float, angle_rad: float, now_s: float) -> float:
        """The speed that keeps up with a commanded speed, with the shaft at `angle_rad` now."""
        moved_rad = self._target_rad + self._speed_rad_s * (now_s - self._since_s)
        nearest_rad = min(max(moved_rad, angle_rad - self._most_behind_rad), angle_rad + self._most_behind_rad)
        return self.speed_to_angle(nearest_rad, speed_rad_s, angle_rad, now_s)
