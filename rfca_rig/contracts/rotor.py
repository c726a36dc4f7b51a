"""Test plant with a known solution: a rotor with inertia and a constant load, and a wrench that is a known function of time."""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from rfca_rig.twins.world import ShaftDrive, ShaftState

Floats = NDArray[np.float64]


@dataclass
class Rotor:
    """Rotor integrated by the implicit midpoint rule at 0.1 ms. The wrench is (1, 2, ... 6) * `swing` * sin(2 pi 5 Hz t)."""

    inertia_kg_m2: float = 0.02
    load_Nm: float = 0.0
    angle_rad: float = 0.3
    speed_rad_s: float = 0.0
    swing: float = 1.0
    now_s: float = 0.0
    torque_Nm: float = 0.0
    drives: list[tuple[float, ShaftDrive]] = field(default_factory=list)

    def advance(self, to_s: float, drive: ShaftDrive, force_times_s: Floats) -> Floats:
        """Advances to `to_s` under `drive`; returns the wrench (m, 6) in N and N m at `force_times_s` (m,)."""
        assert np.all(force_times_s <= to_s)
        assert np.all(force_times_s > self.now_s - 1e-8)
        self.drives.append((to_s, drive))
        steps = max(1, round((to_s - self.now_s) / 1e-4))
        h = (to_s - self.now_s) / steps
        for _ in range(steps):
            self._step(drive, h)
        self.now_s = to_s
        self.torque_Nm = drive.torque_Nm(self.angle_rad, self.speed_rad_s)
        wrench: Floats = self.swing * np.sin(10.0 * np.pi * force_times_s)[:, None] * np.arange(1.0, 7.0)
        return wrench

    def _step(self, drive: ShaftDrive, h: float) -> None:
        # Implicit midpoint for a linear law: the gains act like added inertia, so stiff loops stay stable.
        stiff = self.inertia_kg_m2 + 0.5 * h * drive.speed_gain_Nm_s_per_rad + 0.25 * h * h * drive.angle_gain_Nm_per_rad
        now_Nm = drive.torque_Nm(self.angle_rad + 0.5 * h * self.speed_rad_s, self.speed_rad_s) + self.load_Nm
        gained_rad_s = h * now_Nm / stiff
        self.angle_rad += h * (self.speed_rad_s + 0.5 * gained_rad_s)
        self.speed_rad_s += gained_rad_s

    def shaft(self) -> ShaftState:
        return ShaftState(self.angle_rad, self.speed_rad_s, self.torque_Nm)

    def set_height(self, height_m: float) -> None:
        raise AssertionError(f"a rotor has no height to set to {height_m}")
