"""The nominal rig of the exam's campaigns, its prior standard deviations, and the true rig's
differences from it.

Usual model errors: links and hinges that are not identical, a contact law of another shape. Small,
and no effect of the catalogue.
"""

from dataclasses import dataclass, replace

import numpy as np

from rfca_rig.exam.simulator.floor import TYPICAL_DEPTH_M
from rfca_rig.exam.simulator.world import (
    HINGES,
    LINKS,
    DriveModel,
    Floor,
    Hinges,
    Links,
    Mount,
    World,
    for_each_hinge,
)

LENGTHS_M = (0.054, *(0.039333,) * HINGES)
MASSES_KG = (0.059586, *(0.043402,) * HINGES)
START_RAD = 0.226893
RAMP_S = 0.05
BELOW_SHAFT_M = 0.045
# A measured value is never off by more than this many standard deviations.
WITHIN_SIGMA = 2.0

# Prior standard deviations, as `[known_to]` in the campaign files states them.
HEIGHT_MM = 0.2
START_DEG = 0.3
FRICTION = 0.05
K0_SHARE = 0.03
MASS_SHARE = 0.01
DAMPING_SHARE = 0.5
CONTACT_SHARE = 0.5

# Largest power of the depth in the reduction of friction's lever; the smallest is one over it.
MAX_LEVER_POWER = 1.25


@dataclass(frozen=True)
class NominalErrors:
    """Differences and factors between the true rig and the nominal one, all drawn from the
    stated prior.
    """

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
    """Draw the true rig's differences from the prior: normal, factors log-normal, both clipped
    at WITHIN_SIGMA.
    """
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
    hinges = world.hinges
    links = world.links
    floor = world.floor
    return replace(
        world,
        links=replace(links, mass_kg=_times(links.mass_kg, off.mass_factor)),
        hinges=replace(
            hinges,
            k0_Nm_per_rad=_times(hinges.k0_Nm_per_rad, off.k0_factor),
            damping_Nm_s_per_rad=_times(hinges.damping_Nm_s_per_rad, off.hinge_damping_factor),
        ),
        floor=replace(
            floor,
            mu=floor.mu + off.friction_coefficient,
            stiffness=floor.stiffness * off.contact_stiffness_factor,
        ),
        drive=replace(
            world.drive,
            start_angle_rad=world.drive.start_angle_rad + float(np.radians(off.start_angle_deg)),
        ),
        mount=replace(world.mount, height_m=world.mount.height_m + 1e-3 * off.height_mm),
    )


def _times(values: tuple[float, ...], factor: float) -> tuple[float, ...]:
    return tuple(factor * value for value in values)


@dataclass(frozen=True)
class StructuredError:
    """Factors of lengths and masses (7,), of stiffness and damping (6,), and the shape of the
    contact.
    """

    length: tuple[float, ...]
    mass: tuple[float, ...]
    k0: tuple[float, ...]
    damping: tuple[float, ...]
    exponent: float
    two_sided: bool
    presliding_factor: float
    lever_share: float
    lever_power: float


def draw_structured_error(share: float, random: np.random.Generator) -> StructuredError:
    """Draw relative errors with standard deviation `share`, five times as much for damping; the
    lengths keep their sum.
    """
    length = 1.0 + 0.5 * share * random.normal(size=LINKS)
    return StructuredError(
        length=tuple(length / length.mean()),
        mass=tuple(1.0 + share * random.normal(size=LINKS)),
        k0=tuple(1.0 + share * random.normal(size=HINGES)),
        damping=tuple(np.exp(5.0 * share * random.normal(size=HINGES))),
        exponent=float(1.5 + 2.5 * share * random.uniform(-1.0, 1.0)),
        two_sided=bool(random.random() < 0.3),
        presliding_factor=float(2.0 ** random.uniform(-1.0, 1.0)),
        lever_share=float(random.choice([0.0, 0.5, 1.0])),
        lever_power=float(MAX_LEVER_POWER ** random.spawn(1)[0].uniform(-1.0, 1.0)),
    )


def apply_structured_error(world: World, error: StructuredError) -> World:
    """The world with these errors."""
    links = world.links
    hinges = world.hinges
    # The stiffness keeps the force at a typical depth: only the shape of the law changes.
    return replace(
        world,
        links=replace(
            links,
            length_m=_scale_values(links.length_m, error.length),
            mass_kg=_scale_values(links.mass_kg, error.mass),
        ),
        hinges=replace(
            hinges,
            k0_Nm_per_rad=_scale_values(hinges.k0_Nm_per_rad, error.k0),
            damping_Nm_s_per_rad=_scale_values(hinges.damping_Nm_s_per_rad, error.damping),
        ),
        floor=replace(
            world.floor,
            stiffness=world.floor.stiffness
            * TYPICAL_DEPTH_M ** (world.floor.exponent - error.exponent),
            exponent=error.exponent,
            two_sided=error.two_sided,
            presliding_m=world.floor.presliding_m * error.presliding_factor,
            lever_share=error.lever_share,
            lever_power=error.lever_power,
        ),
    )


def _scale_values(values: tuple[float, ...], factors: tuple[float, ...]) -> tuple[float, ...]:
    return tuple(value * factor for value, factor in zip(values, factors, strict=True))
