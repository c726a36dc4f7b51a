"""The zero of a drive's encoder: what its reading says of the shaft, and what a power-down leaves
of it.
"""

from dataclasses import dataclass
from math import degrees, tau
from typing import Literal

# What of the zero survives a power-down: all of it; all but whole turns of the motor; nothing.
ZeroPolicy = Literal["absolute", "behind-gear", "incremental"]


@dataclass(frozen=True)
class EncoderZero:
    """How a reading of the drive's encoder is converted into the angle of the shaft.

    Parameters
    ----------
    key
        The key of [motor] that states the zero.
    value
        The reading with the leg horizontal.
    unit
        Of the reading: "turns", "rad" or "deg".
    per_shaft_turn
        Change of the reading in one turn of the shaft; negative where it counts upwards.
    per_motor_turn
        Change of the reading in one turn of the motor, above 0.
    """

    key: str
    value: float
    unit: str
    per_shaft_turn: float
    per_motor_turn: float

    def reading(self, angle_rad: float) -> float:
        """The reading at an angle of the shaft."""
        return self.value + self.per_shaft_turn * angle_rad / tau

    def angle_rad(self, reading: float) -> float:
        """The angle of the shaft at a reading."""
        return (reading - self.value) * tau / self.per_shaft_turn

    def zero_at(self, reading: float, angle_rad: float) -> float:
        """The zero with which that reading is that angle."""
        return reading - self.per_shaft_turn * angle_rad / tau

    def shaft_deg(self, change: float) -> float:
        """The size of a change of the reading, in degrees of the shaft."""
        return abs(degrees(change * tau / self.per_shaft_turn))

    def of_degrees(self, shaft_deg: float) -> float:
        """The change of the reading, above 0, over so many degrees of the shaft."""
        return abs(self.per_shaft_turn) * shaft_deg / 360.0
