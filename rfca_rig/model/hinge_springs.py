"""Torsion springs in place of the bent strip (pseudo-rigid-body model): torque and stiffness of every joint, eqs. (3), (6)."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rfca_rig.errors import BadInput
from rfca_rig.model.parameters import Leg
from rfca_rig.model.torque_spline import NO_SPLINE, SplineTable, table_of

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class HingeSprings:
    """k0 x + k0 k2 x^3 per joint, or k0 times the joint's spline; x = phi - `rest_rad`, all (n,). Joint 1 is the shaft and has k0 = 0."""

    k0_Nm_per_rad: Floats
    k2_per_rad2: Floats
    rest_rad: Floats
    splines: SplineTable = NO_SPLINE

    def torque_Nm(self, phi: Floats) -> Floats:
        """Torque (..., n) that bends the springs to `phi` (..., n) [rad]."""
        # A leg has either splines for all hinges or none.
        x = phi - self.rest_rad
        if self.splines.origin.size:
            return np.asarray(self.k0_Nm_per_rad * self.splines.torque(x))
        return np.asarray(self.k0_Nm_per_rad * x * (1.0 + self.k2_per_rad2 * x**2))

    def stiffness_Nm_per_rad(self, phi: Floats) -> Floats:
        """Its derivative K_i (..., n)."""
        x = phi - self.rest_rad
        if self.splines.origin.size:
            return np.asarray(self.k0_Nm_per_rad * self.splines.stiffness(x))
        return np.asarray(self.k0_Nm_per_rad * (1.0 + 3.0 * self.k2_per_rad2 * x**2))


def springs_of(leg: Leg) -> HingeSprings:
    """The springs of a leg."""
    n = len(leg.link_lengths_m)
    k0 = np.full(n, leg.k0_Nm_per_rad)
    k0[0] = 0.0
    rest = np.array([0.0, *leg.rest_angles_rad]) if leg.rest_angles_rad else np.zeros(n)
    return HingeSprings(k0, np.full(n, leg.k2_per_rad2), rest, table_of(leg.torque_splines, n))


def polynomial_springs(leg: Leg, where: str) -> tuple[float, float, float]:
    """Coefficients of phi, phi |phi| and phi^3, for programs without other springs; BadInput, which names them, for a measured curve."""
    if leg.torque_splines:
        raise BadInput(
            f"leg.torque_rotation: {where} takes springs k0 phi + k0 k2 phi^3 only, not a measured curve; "
            "give a model with k0 and k2, as static report writes it"
        )
    return leg.k0_Nm_per_rad, 0.0, leg.k0_Nm_per_rad * leg.k2_per_rad2


def bending_torque_Nm(leg: Leg, x_rad: Floats) -> Floats:
    """Torque of a hinge, (m,) or any other shape, at `x_rad` from rest; the mean of all hinges where each has its own curve."""
    springs = springs_of(leg)
    return _of_hinges(leg, springs.torque_Nm(springs.rest_rad + x_rad[..., None]))


def bending_stiffness_Nm_per_rad(leg: Leg, x_rad: Floats) -> Floats:
    """Derivative of `bending_torque_Nm`, of the same shape (m,) as `x_rad` [N m/rad]."""
    springs = springs_of(leg)
    return _of_hinges(leg, springs.stiffness_Nm_per_rad(springs.rest_rad + x_rad[..., None]))


def _of_hinges(leg: Leg, each: Floats) -> Floats:
    return np.asarray(each[..., 1:].mean(axis=-1) if len(leg.torque_splines) > 1 else each[..., 1])
