"""Readings of a leg at rest on the ground, and the contact of each link end."""

from dataclasses import dataclass
from enum import Enum

import numpy as np
from numpy.typing import NDArray

from rfca_rig.model.parameters import GRAVITY_M_S2, RigModel

Floats = NDArray[np.float64]

AT_THE_LIMIT = 1.0 - 1e-6  # share of mu N from which on friction counts as fully used


class Touch(Enum):
    """Contact state of the end of a link."""

    AIR = "air"
    STUCK = "stuck"
    SLIDING = "sliding"


@dataclass(frozen=True)
class StaticState:
    """The leg held at one shaft angle, forces in the sensor's axes and signs.

    `q_rad` (n,) absolute link angles; `hinge_angles_rad` (n - 1,) of hinges 2..n; `normal_N`, `tangential_N` (n,) and `touch`
    (n,) at the end of each link, as they act on the leg (up, and along +y). SLIDING means that friction is at its limit mu N.
    `jumped` if the leg has passed a place without equilibrium since the state before; never set for a path that is simulated in time.
    """

    q_rad: Floats
    fy_N: float
    fz_N: float
    tx_Nm: float
    shaft_torque_Nm: float
    normal_N: Floats
    tangential_N: Floats
    touch: tuple[Touch, ...]
    jumped: bool

    @property
    def shaft_angle_rad(self) -> float:
        return float(self.q_rad[0])

    @property
    def hinge_angles_rad(self) -> Floats:
        return np.diff(self.q_rad)


def make_static_state(
    rig: RigModel, q_rad: Floats, shaft_torque_Nm: float, normal_N: Floats, tangential_N: Floats, jumped: bool
) -> StaticState:
    """The state of a plain leg at rest with angles `q_rad` (n,) and ground forces (n,); the mount carries ground forces and weight."""
    fy = -float(tangential_N.sum())
    weight = sum(rig.leg.link_masses_kg) * GRAVITY_M_S2
    return StaticState(
        q_rad=q_rad,
        fy_N=fy,
        fz_N=weight - float(normal_N.sum()),
        tx_Nm=shaft_torque_Nm + rig.sensor.below_shaft_m * fy,
        shaft_torque_Nm=shaft_torque_Nm,
        normal_N=normal_N,
        tangential_N=tangential_N,
        touch=touches(rig.ground.friction_coefficient, normal_N, tangential_N),
        jumped=jumped,
    )


def touches(mu: float, normal_N: Floats, tangential_N: Floats) -> tuple[Touch, ...]:
    """Contact state of each end (n,) for its normal and tangential force (n,), with mu the friction coefficient at rest."""
    return tuple(_touch(mu, N, F) for N, F in zip(normal_N, tangential_N, strict=True))


def _touch(mu: float, normal: float, tangential: float) -> Touch:
    if normal == 0.0:
        return Touch.AIR
    return Touch.SLIDING if abs(tangential) >= AT_THE_LIMIT * mu * abs(normal) else Touch.STUCK
