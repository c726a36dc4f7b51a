"""Usual model errors: links and hinges that are not identical, a contact law of another shape. Small, and no effect of the catalogue."""

from dataclasses import dataclass, replace

import numpy as np

from rfca_rig.exam.engine_floor import TYPICAL_DEPTH_M
from rfca_rig.exam.world import HINGES, LINKS, Floor, World

# Largest power of the depth in the reduction of friction's lever; the smallest is one over it.
MAX_LEVER_POWER = 1.25


@dataclass(frozen=True)
class StructuredError:
    """Factors of lengths and masses (7,), of stiffness and damping (6,), and the shape of the contact."""

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
    """Draw relative errors with standard deviation `share`, five times as much for damping; the lengths keep their sum."""
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
    links, hinges = world.links, world.hinges
    return replace(
        world,
        links=replace(links, length_m=_each(links.length_m, error.length), mass_kg=_each(links.mass_kg, error.mass)),
        hinges=replace(
            hinges,
            k0_Nm_per_rad=_each(hinges.k0_Nm_per_rad, error.k0),
            damping_Nm_s_per_rad=_each(hinges.damping_Nm_s_per_rad, error.damping),
        ),
        floor=_reshape(world.floor, error),
    )


def _reshape(floor: Floor, error: StructuredError) -> Floor:
    # The stiffness keeps the force at a typical depth: only the shape of the law changes.
    return replace(
        floor,
        stiffness=floor.stiffness * TYPICAL_DEPTH_M ** (floor.exponent - error.exponent),
        exponent=error.exponent,
        two_sided=error.two_sided,
        presliding_m=floor.presliding_m * error.presliding_factor,
        lever_share=error.lever_share,
        lever_power=error.lever_power,
    )


def _each(values: tuple[float, ...], factors: tuple[float, ...]) -> tuple[float, ...]:
    return tuple(value * factor for value, factor in zip(values, factors, strict=True))
