"""Physics that is in no catalogue. The right answer to them is that something is unexplained, never a name."""

from collections.abc import Callable, Mapping
from dataclasses import replace

import numpy as np

from rfca_rig.exam.world import World, everywhere

Values = Mapping[str, float]

STIFF_SHAFT_NM_PER_RAD = 2000.0


def with_stranger(world: World, name: str, values: Values, repeat: int) -> World:
    """The world with one stranger in it, as it is in this repeat (from 1)."""
    if name == "stiffness_falls_with_repeats":
        return _softened(world, (1.0 - values["share_per_repeat"]) ** (repeat - 1))
    return STRANGERS[name](world, values)


def _softened(world: World, factor: float) -> World:
    k0 = tuple(factor * each for each in world.hinges.k0_Nm_per_rad)
    return replace(world, hinges=replace(world.hinges, k0_Nm_per_rad=k0))


def loose_grub_screw(world: World, values: Values) -> World:
    """Play between motor and leg, stiff on either side of it."""
    gap, k = float(np.radians(values["half_gap_deg"])), STIFF_SHAFT_NM_PER_RAD
    return replace(world, drive=replace(world.drive, shaft_gap_rad=gap, shaft_Nm_per_rad=k, shaft_Nm_s_per_rad=1e-3 * k))


def cable_drag(world: World, values: Values) -> World:
    """A cable at the shaft that drags against the turn with the same torque at any speed."""
    return replace(world, drive=replace(world.drive, cable_Nm=values["torque_Nm"]))


def force_cogging(world: World, values: Values) -> World:
    """A ripple over the shaft angle that only fz shows."""
    sensing = replace(world.sensing, cogging_N=values["force_N"], cogging_cycles=values["cycles_per_turn"])
    return replace(world, sensing=sensing)


def hinge_asymmetry(world: World, values: Values) -> World:
    """Hinges stiffer one way than the other."""
    return replace(world, hinges=replace(world.hinges, asymmetry=everywhere(values["share"])))


def hinge_quadratic_damping(world: World, values: Values) -> World:
    """Hinge damping with the square of the rate."""
    quadratic = everywhere(values["coefficient_Nm_s2_per_rad2"])
    return replace(world, hinges=replace(world.hinges, quadratic_Nm_s2_per_rad2=quadratic))


def floor_magnet(world: World, values: Values) -> World:
    """A floor that attracts the tip from afar."""
    return replace(world, floor=replace(world.floor, magnet_N=values["force_N"], magnet_reach_m=1e-3 * values["reach_mm"]))


def friction_by_direction(world: World, values: Values) -> World:
    """A floor rougher against one direction of sliding."""
    return replace(world, floor=replace(world.floor, mu_backward_share=values["backward_share"]))


def sensor_curvature(world: World, values: Values) -> World:
    """A sensor whose gain grows or falls with the force."""
    return replace(world, sensing=replace(world.sensing, curvature_per_N=values["per_N"]))


def sensor_clipping(world: World, values: Values) -> World:
    """A sensor that saturates."""
    return replace(world, sensing=replace(world.sensing, clip_N=values["limit_N"]))


def one_heavier_link(world: World, values: Values) -> World:
    """One link heavier than its fellows; link 1 is at the shaft."""
    mass = list(world.links.mass_kg)
    mass[round(values["link"]) - 1] *= values["factor"]
    return replace(world, links=replace(world.links, mass_kg=tuple(mass)))


def floor_bump(world: World, values: Values) -> World:
    """A bump where the tip slides."""
    height, at, width = (1e-3 * values[name] for name in ("height_mm", "at_mm", "width_mm"))
    return replace(world, floor=replace(world.floor, bump_m=height, bump_at_m=at, bump_width_m=width))


STRANGERS: Mapping[str, Callable[[World, Values], World]] = {
    stranger.__name__: stranger
    for stranger in (
        loose_grub_screw,
        cable_drag,
        force_cogging,
        hinge_asymmetry,
        hinge_quadratic_damping,
        floor_magnet,
        friction_by_direction,
        sensor_curvature,
        sensor_clipping,
        one_heavier_link,
        floor_bump,
    )
}
NAMES = (*STRANGERS, "stiffness_falls_with_repeats")
