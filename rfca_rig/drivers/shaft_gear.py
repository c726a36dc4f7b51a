"""Conversion between the turns of a drive and the angle of the shaft: gear, direction, zero."""

from math import isfinite, tau

from rfca_rig.errors import BadInput


class ShaftGear:
    """Base of settings with these three values.

    `gear_ratio` is drive turns per shaft turn, `direction` +1 or -1, `zero_turns` the drive's reading with the shaft horizontal.
    """

    gear_ratio: float
    direction: int
    zero_turns: float

    def check_gear(self) -> None:
        """Raises BadInput for invalid values."""
        if self.direction not in {1, -1}:
            raise BadInput(f"drive: direction is {self.direction}, must be 1 or -1")
        if not isfinite(self.zero_turns):
            raise BadInput(f"drive: zero_turns is {self.zero_turns}, must be a number")
        check_positive("gear_ratio", self.gear_ratio)

    def turns(self, angle_rad: float) -> float:
        """Drive position in turns at a shaft angle in rad."""
        return self.zero_turns + self.turns_s(angle_rad)

    def turns_s(self, speed_rad_s: float) -> float:
        """Drive speed in turns/s at a shaft speed in rad/s."""
        return self.direction * self.gear_ratio * speed_rad_s / tau

    @property
    def shaft_rad_per_turn(self) -> float:
        """Shaft angle in rad per turn of the drive, signed."""
        return self.direction * tau / self.gear_ratio

    @property
    def shaft_torque_per_drive_torque(self) -> float:
        """Shaft torque over drive torque, signed, for a gear without losses."""
        return self.direction * self.gear_ratio


def check_positive(name: str, value: float) -> None:
    """Raises BadInput if `value` is not a finite number above 0."""
    if not (isfinite(value) and value > 0.0):
        raise BadInput(f"drive: {name} is {value}, must be above 0")
