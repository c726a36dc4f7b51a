"""The mechanics behind the twins, as the twins see it. What fills it in is put together above, from the model."""

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class ShaftDrive:
    """Torque on the shaft until further notice: feed + angle_gain (angle - q) + speed_gain (speed - dq/dt), SI at the shaft."""

    feed_Nm: float = 0.0
    angle_gain_Nm_per_rad: float = 0.0
    angle_rad: float = 0.0
    speed_gain_Nm_s_per_rad: float = 0.0
    speed_rad_s: float = 0.0

    def torque_Nm(self, angle_rad: float, speed_rad_s: float) -> float:
        """The torque on a shaft that stands at that angle and turns at that speed."""
        return (
            self.feed_Nm
            + self.angle_gain_Nm_per_rad * (self.angle_rad - angle_rad)
            + self.speed_gain_Nm_s_per_rad * (self.speed_rad_s - speed_rad_s)
        )


@dataclass(frozen=True)
class ShaftState:
    """The shaft now, and the motor's torque on it."""

    angle_rad: float
    speed_rad_s: float
    torque_Nm: float


class TwinPlant(Protocol):
    """Leg, rack and ground: moved by the motor twin, felt by the sensor twin."""

    def advance(self, to_s: float, drive: ShaftDrive, force_times_s: Floats) -> Floats:
        """Moves on to `to_s` under `drive`; returns the true wrench (m, 6) [N, N m] at `force_times_s` (ascending, <= to_s)."""
        ...

    def shaft(self) -> ShaftState:
        """The shaft at the time last advanced to."""
        ...

    def set_height(self, height_m: float) -> None:
        """Puts the rack elsewhere, at once."""
        ...
