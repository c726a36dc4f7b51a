"""A plant that costs next to nothing: a heavy arm on the shaft that swings, and brushes a soft
floor on its way round.
"""

from dataclasses import dataclass
from math import ceil, cos, sin

import numpy as np

from rfca_rig.twins.world import ShaftDrive, ShaftState

STEP_S = 5e-4
ARM_M = 0.29
WEIGHT_N = 3.1
FLOOR_N_per_m = 500.0


@dataclass
class Pendulum:
    """Implicit midpoint; angle 0 is horizontal, positive downwards. The sensor feels the weight
    and the floor.
    """

    angle_rad: float
    height_m: float = 0.25
    inertia_kg_m2: float = 0.015
    friction_Nm_s_per_rad: float = 0.15
    speed_rad_s: float = 0.0
    torque_Nm: float = 0.0
    _now_s: float = 0.0

    def advance(self, to_s: float, drive: ShaftDrive, force_times_s: np.ndarray) -> np.ndarray:
        steps = max(1, ceil((to_s - self._now_s) / STEP_S - 1e-6))
        h = (to_s - self._now_s) / steps
        for _ in range(steps):
            self._step(drive, h)
        self._now_s = to_s
        self.torque_Nm = drive.torque_Nm(self.angle_rad, self.speed_rad_s)
        floor_N = self._floor_N()
        return np.tile(
            [0.0, 0.3 * floor_N, WEIGHT_N - floor_N, 0.5 * self.torque_Nm, 0.0, 0.0],
            (len(force_times_s), 1),
        )

    def _floor_N(self) -> float:
        return FLOOR_N_per_m * max(ARM_M * sin(self.angle_rad) - self.height_m, 0.0)

    def _step(self, drive: ShaftDrive, h: float) -> None:
        load_Nm = (
            0.5 * WEIGHT_N * cos(self.angle_rad) - 0.3 * self._floor_N()
        ) * ARM_M - self.friction_Nm_s_per_rad * self.speed_rad_s
        stiff = (
            self.inertia_kg_m2
            + 0.5 * h * drive.speed_gain_Nm_s_per_rad
            + 0.25 * h * h * drive.angle_gain_Nm_per_rad
        )
        gained_rad_s = (
            h
            * (
                drive.torque_Nm(self.angle_rad + 0.5 * h * self.speed_rad_s, self.speed_rad_s)
                + load_Nm
            )
            / stiff
        )
        self.angle_rad += h * (self.speed_rad_s + 0.5 * gained_rad_s)
        self.speed_rad_s += gained_rad_s

    def shaft(self) -> ShaftState:
        return ShaftState(self.angle_rad, self.speed_rad_s, self.torque_Nm)

    def set_height(self, height_m: float) -> None:
        self.height_m = height_m
