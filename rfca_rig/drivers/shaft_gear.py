"""Between a drive that counts turns and the shaft that it turns: gear, direction, zero."""

from math import isfinite, tau

from rfca_rig.errors import BadInput


class ShaftGear:
    """For settings that have these three: `gear_ratio` is the drive's turns per shaft turn, `direction` +1 or -1, `zero_turns` what the
    drive reads with the shaft horizontal.
    """

    gear_ratio: float
    direction: int
    zero_turns: float

    def check_gear(self) -> None:
        """Raises BadInput for values that cannot be."""
        if self.direction not in {1, -1}:
            raise BadInput(f"drive: direction is {self.direction}, must be 1 or -1")
        if not isfinite(self.zero_turns):
            raise BadInput(f"drive: zero_turns is {self.zero_turns}, must be a number")
        check_positive("gear_ratio", self.gear_ratio)

    def turns(self, angle_rad: float) -> float:
        """The drive's turns at a shaft angle."""
        return self.zero_turns + self.turns_s(angle_rad)

    def turns_s(self, speed_rad_s: float) -> float:
        """The drive's speed at a shaft speed."""
        return self.direction * self.gear_ratio * speed_rad_s / tau

    @property
    def shaft_rad_per_turn(self) -> float:
        """Signed: shaft radians per turn of the drive."""
        return self.direction * tau / self.gear_ratio

    @property
    def shaft_torque_per_drive_torque(self) -> float:
        """Signed, for a gear without losses."""
        return self.direction * self.gear_ratio


def check_positive(name: str, value: float) -> None:
    """Raises BadInput for what is not a number above 0."""
    if not (isfinite(value) and value > 0.0):
        raise BadInput(f"drive: {name} is {value}, must be above 0")
