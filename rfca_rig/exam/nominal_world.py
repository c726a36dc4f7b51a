"""The nominal rig of the exam's campaigns, its prior standard deviations, and the true rig's differences from it."""

from dataclasses import dataclass, replace

import numpy as np

from rfca_rig.exam.world import HINGES, DriveModel, Floor, Hinges, Links, Mount, World, for_each_hinge

LENGTHS_M = (0.054, *(0.039333,) * HINGES)
MASSES_KG = (0.059586, *(0.043402,) * HINGES)
START_RAD = 0.226893
RAMP_S = 0.05
BELOW_SHAFT_M = 0.045
# A measured value is never off by more than this many standard deviations.
WITHIN_SIGMA = 2.0

# Prior standard deviations, as `[known_to]` in the campaign files states them.
HEIGHT_MM, START_DEG, FRICTION, K0_SHARE, MASS_SHARE, DAMPING_SHARE, CONTACT_SHARE = 0.2, 0.3, 0.05, 0.03, 0.01, 0.5, 0.5


@dataclass(frozen=True)
class NominalErrors:
    """Differences and factors between the true rig and the nominal one, all drawn from the stated prior."""

    height_mm: float = 0.0
    start_angle_deg: float = 0.0
    friction_coefficient: float = 0.0
    k0_factor: float = 1.0
    mass_factor: float = 1.0
    hinge_damping_factor: float = 1.0
    contact_stiffness_factor: float = 1.0


def nominal_world(height_m: float) -> World:
    """The nominal leg at one height in m, without hidden effects."""
    return World(
        Links(LENGTHS_M, MASSES_KG, 0.003),
        Hinges(for_each_hinge(11.0), for_each_hinge(4.2), for_each_hinge(0.05)),
        Floor(stiffness=1e5, damping_s_per_m=1.0, mu=0.45),
        DriveModel(START_RAD, RAMP_S),
        Mount(height_m, BELOW_SHAFT_M),
    )


def draw_nominal_errors(random: np.random.Generator) -> NominalErrors:
    """Draw the true rig's differences from the prior: normal, factors log-normal, both clipped at WITHIN_SIGMA."""
    x = np.clip(random.normal(size=7), -WITHIN_SIGMA, WITHIN_SIGMA)
    return NominalErrors(
        height_mm=float(HEIGHT_MM * x[0]),
        start_angle_deg=float(START_DEG * x[1]),
        friction_coefficient=float(FRICTION * x[2]),
        k0_factor=float(np.exp(K0_SHARE * x[3])),
        mass_factor=float(np.exp(MASS_SHARE * x[4])),
        hinge_damping_factor=float(np.exp(DAMPING_SHARE * x[5])),
        contact_stiffness_factor=float(np.exp(CONTACT_SHARE * x[6])),
    )


def apply_nominal_errors(world: World, off: NominalErrors) -> World:
    """The world with the true values in place of the nominal ones."""
    hinges, links, floor = world.hinges, world.links, world.floor
    return replace(
        world,
        links=replace(links, mass_kg=_times(links.mass_kg, off.mass_factor)),
        hinges=replace(
            hinges,
            k0_Nm_per_rad=_times(hinges.k0_Nm_per_rad, off.k0_factor),
            damping_Nm_s_per_rad=_times(hinges.damping_Nm_s_per_rad, off.hinge_damping_factor),
        ),
        floor=replace(floor, mu=floor.mu + off.friction_coefficient, stiffness=floor.stiffness * off.contact_stiffness_factor),
        drive=replace(world.drive, start_angle_rad=world.drive.start_angle_rad + float(np.radians(off.start_angle_deg))),
        mount=replace(world.mount, height_m=world.mount.height_m + 1e-3 * off.height_mm),
    )


def _times(values: tuple[float, ...], factor: float) -> tuple[float, ...]:
    return tuple(factor * value for value in values)
