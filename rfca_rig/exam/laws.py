"""The law of a concealed effect, drawn from a wider family than the catalogue's: no case shares its law with the model exactly.

The spans are about what the literature gives for each law: Stribeck exponents from 0.5 to 2 (Armstrong-Helouvry et al., Automatica 30
(1994) 1083), presliding of a pin up to half a degree, and drag exponents around 2.
"""

from dataclasses import dataclass, replace

import numpy as np

from rfca_rig.exam.world import HINGES, World, everywhere

HINGE_SPREAD = 0.05  # standard deviation of an effect's size from hinge to hinge
HINGE_SIZES = ("pin_Nm", "gap_rad", "stop_Nm_per_rad", "loop_Nm", "arm_Nm_per_rad")


@dataclass(frozen=True)
class Law:
    """What the catalogue fixes or does not know: factors of an effect's size in each hinge (6,), and shapes of single laws.

    The pin's friction is full after `pin_creep_deg`; friction falls with this power of the sliding speed; adhesion takes hold over
    `adhesion_hold_mm`; drag grows with this power of the speed; the ripple of the shaft's speed has a phase.
    """

    of_hinge: tuple[float, ...]
    pin_creep_deg: float
    stribeck_power: float
    adhesion_hold_mm: float
    drag_power: float
    ripple_phase_rad: float


def drawn_law(random: np.random.Generator) -> Law:
    """A member of the wider families."""
    return Law(
        of_hinge=tuple(np.exp(HINGE_SPREAD * random.normal(size=HINGES)).tolist()),
        pin_creep_deg=float(0.03 * 20.0 ** random.random()),
        stribeck_power=float(random.uniform(0.6, 2.2)),
        adhesion_hold_mm=float(0.03 * 20.0 ** random.random()),
        drag_power=float(random.uniform(1.8, 2.2)),
        ripple_phase_rad=float(random.uniform(-np.pi, np.pi)),
    )


def shape_laws(world: World, law: Law, damping_before: tuple[float, ...]) -> World:
    """The world whose effects are in it already, with this law; what hinges damped before keeps its size."""
    hinges = scale_hinges(world, law.of_hinge, damping_before).hinges
    return replace(
        world,
        hinges=replace(hinges, pin_creep_rad=everywhere(float(np.radians(law.pin_creep_deg)))),
        floor=replace(world.floor, stribeck_power=law.stribeck_power, adhesion_hold_m=1e-3 * law.adhesion_hold_mm),
        links=replace(world.links, drag_power=law.drag_power),
        drive=replace(world.drive, ripple_phase_rad=law.ripple_phase_rad),
    )


def scale_hinges(world: World, of_hinge: tuple[float, ...], damping_before: tuple[float, ...]) -> World:
    """The world with what its effects do in each hinge scaled by these factors (6,)."""
    hinges = world.hinges
    scaled = {name: tuple(x * factor for x, factor in zip(getattr(hinges, name), of_hinge, strict=True)) for name in HINGE_SIZES}
    more = zip(hinges.damping_Nm_s_per_rad, damping_before, of_hinge, strict=True)
    damping = tuple(base + (whole - base) * factor for whole, base, factor in more)
    return replace(world, hinges=replace(hinges, **scaled, damping_Nm_s_per_rad=damping))
