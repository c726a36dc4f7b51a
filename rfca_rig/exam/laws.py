"""Laws of hidden effects, drawn from wider families than the catalogue's, so that no case has exactly the model's law.

The ranges are about those of the literature: Stribeck exponents from 0.5 to 2 (Armstrong-Helouvry et al., Automatica 30 (1994) 1083),
presliding of a pin up to half a degree, and drag exponents around 2.
"""

from dataclasses import dataclass, replace

import numpy as np

from rfca_rig.exam.world import HINGES, World, for_each_hinge

# Relative standard deviation of an effect's size between hinges.
HINGE_SPREAD = 0.05
HINGE_SIZES = ("pin_Nm", "gap_rad", "stop_Nm_per_rad", "loop_Nm", "arm_Nm_per_rad")


@dataclass(frozen=True)
class Law:
    """Properties that the catalogue fixes or lacks: factors of an effect's size in each hinge (6,), and shapes of single laws.

    The pin's friction is full after `pin_creep_deg`. Ground friction falls with the power `stribeck_power` of the sliding speed.
    Adhesion builds up over `adhesion_hold_mm`. Drag grows with `drag_power` of the speed. The ripple of the shaft's speed has a phase.
    """

    of_hinge: tuple[float, ...]
    pin_creep_deg: float
    stribeck_power: float
    adhesion_hold_mm: float
    drag_power: float
    ripple_phase_rad: float


def draw_law(random: np.random.Generator) -> Law:
    """Draw a member of the wider families."""
    return Law(
        of_hinge=tuple(np.exp(HINGE_SPREAD * random.normal(size=HINGES)).tolist()),
        # Log-uniform from 0.03 to 0.6, for the creep in degrees and for the hold in mm.
        pin_creep_deg=float(0.03 * 20.0 ** random.random()),
        stribeck_power=float(random.uniform(0.6, 2.2)),
        adhesion_hold_mm=float(0.03 * 20.0 ** random.random()),
        drag_power=float(random.uniform(1.8, 2.2)),
        ripple_phase_rad=float(random.uniform(-np.pi, np.pi)),
    )


def shape_laws(world: World, law: Law, damping_before: tuple[float, ...]) -> World:
    """The world, which has its effects already, with this law; the damping before the effects (6,) is not scaled."""
    hinges = scale_hinges(world, law.of_hinge, damping_before).hinges
    return replace(
        world,
        hinges=replace(hinges, pin_creep_rad=for_each_hinge(float(np.radians(law.pin_creep_deg)))),
        floor=replace(world.floor, stribeck_power=law.stribeck_power, adhesion_hold_m=1e-3 * law.adhesion_hold_mm),
        links=replace(world.links, drag_power=law.drag_power),
        drive=replace(world.drive, ripple_phase_rad=law.ripple_phase_rad),
    )


def scale_hinges(world: World, of_hinge: tuple[float, ...], damping_before: tuple[float, ...]) -> World:
    """The world with its effects in each hinge scaled by these factors (6,).

    Of the damping, only what exceeds `damping_before` (6,) belongs to an effect and is scaled.
    """
    hinges = world.hinges
    scaled = {name: tuple(x * factor for x, factor in zip(getattr(hinges, name), of_hinge, strict=True)) for name in HINGE_SIZES}
    more = zip(hinges.damping_Nm_s_per_rad, damping_before, of_hinge, strict=True)
    damping = tuple(base + (whole - base) * factor for whole, base, factor in more)
    return replace(world, hinges=replace(hinges, **scaled, damping_Nm_s_per_rad=damping))
