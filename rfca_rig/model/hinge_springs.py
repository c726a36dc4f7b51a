"""The torsion springs that stand for the bent strip: torque and stiffness of every joint, eqs. (3), (6)."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rfca_rig.model.parameters import Leg

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class HingeSprings:
    """k0 x + k0 k2 x^3 per joint, x = phi - `rest_rad`, all (n,). Joint 1 is the driven shaft and has k0 = 0."""

    k0_Nm_per_rad: Floats
    k2_per_rad2: Floats
    rest_rad: Floats

    def torque_Nm(self, phi: Floats) -> Floats:
        """Torque (n,) that bends the springs to `phi` (n,) [rad]."""
        x = phi - self.rest_rad
        return np.asarray(self.k0_Nm_per_rad * x * (1.0 + self.k2_per_rad2 * x**2))

    def stiffness_Nm_per_rad(self, phi: Floats) -> Floats:
        """Its derivative K_i (n,)."""
        return np.asarray(self.k0_Nm_per_rad * (1.0 + 3.0 * self.k2_per_rad2 * (phi - self.rest_rad) ** 2))


def springs_of(leg: Leg) -> HingeSprings:
    """The springs of a leg, alike but for their rest angles."""
    n = len(leg.link_lengths_m)
    k0 = np.full(n, leg.k0_Nm_per_rad)
    k0[0] = 0.0
    rest = np.array([0.0, *leg.rest_angles_rad]) if leg.rest_angles_rad else np.zeros(n)
    return HingeSprings(k0, np.full(n, leg.k2_per_rad2), rest)
