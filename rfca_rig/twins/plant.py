"""Interface of the twins to the mechanics. The implementations, based on the model, are in other packages."""

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class ShaftDrive:
    """Linear torque law of a drive, in SI units at the shaft: feed + angle_gain (angle - q) + speed_gain (speed - dq/dt)."""

    feed_Nm: float = 0.0
    angle_gain_Nm_per_rad: float = 0.0
    angle_rad: float = 0.0
    speed_gain_Nm_s_per_rad: float = 0.0
    speed_rad_s: float = 0.0

    def torque_Nm(self, angle_rad: float, speed_rad_s: float) -> float:
        """Torque in N m at a shaft angle and speed."""
        return (
            self.feed_Nm
            + self.angle_gain_Nm_per_rad * (self.angle_rad - angle_rad)
            + self.speed_gain_Nm_s_per_rad * (self.speed_rad_s - speed_rad_s)
        )


@dataclass(frozen=True)
class ShaftState:
    """Present state of the shaft, and the motor's torque on it."""

    angle_rad: float
    speed_rad_s: float
    torque_Nm: float


class TwinPlant(Protocol):
    """Mechanics of leg, rack and ground: driven by the motor twin, measured by the sensor twin."""

    def advance(self, to_s: float, drive: ShaftDrive, force_times_s: Floats) -> Floats:
        """Advances to `to_s` under `drive`; returns the true wrench (m, 6) [N, N m] at `force_times_s` (m,), ascending and <= to_s."""
        ...

    def shaft(self) -> ShaftState:
        """State of the shaft at the time of the last `advance`."""
        ...

    def set_height(self, height_m: float) -> None:
        """Sets the height of the rack in m, at once."""
        ...
