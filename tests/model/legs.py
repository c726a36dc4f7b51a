"""Rigs for the tests of the model."""

from dataclasses import replace

import numpy as np

from rfca_rig.model.parameters import Drive, Ground, Leg, RigModel, SensorMount

LENGTHS = (0.054, *[0.039333] * 6)

PAPER = RigModel(
    leg=Leg(
        link_lengths_m=LENGTHS,
        link_masses_kg=tuple(0.32 * length / sum(LENGTHS) for length in LENGTHS),
        link_radius_m=0.003,
        k0_Nm_per_rad=10.98,
        k2_per_rad2=4.56,
        hinge_damping_Nm_s_per_rad=0.088,
        start_angle_rad=float(np.radians(14.1)),
    ),
    ground=Ground(1e5, 1.0, 0.41, 1e-4, 2.0),
    sensor=SensorMount(0.045),
    drive=Drive(0.05),
)

NO_GROUND_M = 10.0


def pendulum(
    links: int = 1,
    length_m: float = 0.5,
    mass_kg: float = 0.4,
    hinge_damping: float = 0.0,
    k0: float = 0.0,
) -> RigModel:
    """A chain of equal links, springless unless told."""
    leg = Leg((length_m,) * links, (mass_kg,) * links, 0.0, k0, 0.0, hinge_damping, 0.0)
    return replace(PAPER, leg=leg)
