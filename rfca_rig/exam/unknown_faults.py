"""Effects outside the catalogue. The right answer to them is "unexplained", never a named effect."""

from collections.abc import Callable, Mapping
from dataclasses import replace

from rfca_rig.exam.world import World, for_each_hinge

Values = Mapping[str, float]


def with_unknown_fault(world: World, name: str, values: Values, repeat: int) -> World:
    """The world with one effect from outside the catalogue, as it is in this repeat (from 1)."""
    if name == "stiffness_falls_with_repeats":
        return _soften(world, (1.0 - values["share_per_repeat"]) ** (repeat - 1))
    return STRANGERS[name](world, values)


def _soften(world: World, factor: float) -> World:
    k0 = tuple(factor * each for each in world.hinges.k0_Nm_per_rad)
    return replace(world, hinges=replace(world.hinges, k0_Nm_per_rad=k0))


def force_cogging(world: World, values: Values) -> World:
    """A ripple of fz over the shaft angle, in no other channel."""
    sensing = replace(world.sensing, cogging_N=values["force_N"], cogging_cycles=values["cycles_per_turn"])
    return replace(world, sensing=sensing)


def hinge_asymmetry(world: World, values: Values) -> World:
    """Hinges that are stiffer in one direction than in the other."""
    return replace(world, hinges=replace(world.hinges, asymmetry=for_each_hinge(values["share"])))


def floor_magnet(world: World, values: Values) -> World:
    """A floor that attracts the tip from afar."""
    return replace(world, floor=replace(world.floor, magnet_N=values["force_N"], magnet_reach_m=1e-3 * values["reach_mm"]))


def friction_by_direction(world: World, values: Values) -> World:
    """A floor with more friction in one direction of sliding."""
    return replace(world, floor=replace(world.floor, mu_backward_share=values["backward_share"]))


def sensor_curvature(world: World, values: Values) -> World:
    """A sensor whose gain grows or falls with the force."""
    return replace(world, sensing=replace(world.sensing, curvature_per_N=values["per_N"]))


def sensor_play(world: World, values: Values) -> World:
    """A loop of fz, as of a mount that shifts under load."""
    return replace(world, sensing=replace(world.sensing, play_N=values["half_width_N"]))


def sensor_creep(world: World, values: Values) -> World:
    """A reading of fz that continues to creep after the force is constant."""
    return replace(world, sensing=replace(world.sensing, creep_share=values["share"], creep_s=values["time_s"]))


def mains_hum(world: World, values: Values) -> World:
    """Interference of the mains frequency, or of twice that, in fz."""
    return replace(world, sensing=replace(world.sensing, hum_N=values["amplitude_N"], hum_Hz=values["frequency_Hz"]))


def sensor_dead_band(world: World, values: Values) -> World:
    """Small forces that read zero."""
    return replace(world, sensing=replace(world.sensing, dead_N=values["below_N"]))


def coarse_digits(world: World, values: Values) -> World:
    """A converter of fz with too few digits for its range."""
    return replace(world, sensing=replace(world.sensing, digit_N=values["digit_N"]))


def hinge_detents(world: World, values: Values) -> World:
    """Hinges that snap to even angles, as between magnets."""
    detent, per_rad = for_each_hinge(values["torque_Nm"]), for_each_hinge(values["per_turn"])
    return replace(world, hinges=replace(world.hinges, detent_Nm=detent, detents_per_rad=per_rad))


def tendon(world: World, values: Values) -> World:
    """An elastic cord along all hinges: its torque on each is proportional to the sum of all hinge angles."""
    return replace(world, hinges=replace(world.hinges, tendon_Nm_per_rad=for_each_hinge(values["stiffness_Nm_per_rad"])))


def slick_patch(world: World, values: Values) -> World:
    """A patch of the floor with less friction, as where oil has dripped."""
    at, width = 1e-3 * values["at_mm"], 1e-3 * values["width_mm"]
    return replace(world, floor=replace(world.floor, patch_at_m=at, patch_width_m=width, patch_mu_factor=values["friction_factor"]))


def soft_patch(world: World, values: Values) -> World:
    """A patch of the floor that is softer, as over a hole under the mat."""
    at, width = 1e-3 * values["at_mm"], 1e-3 * values["width_mm"]
    return replace(world, floor=replace(world.floor, patch_at_m=at, patch_width_m=width, patch_stiffness_factor=values["stiffness_factor"]))


def shaking_floor(world: World, values: Values) -> World:
    """A machine next door that shakes the floor."""
    return replace(world, floor=replace(world.floor, shake_m=1e-3 * values["amplitude_mm"], shake_Hz=values["frequency_Hz"]))


def hose_at_the_shaft(world: World, values: Values) -> World:
    """A stiff hose or cable that turns the shaft back to where it started."""
    return replace(world, drive=replace(world.drive, hose_Nm_per_rad=values["stiffness_Nm_per_rad"]))


STRANGERS: Mapping[str, Callable[[World, Values], World]] = {
    stranger.__name__: stranger
    for stranger in (
        force_cogging,
        hinge_asymmetry,
        floor_magnet,
        friction_by_direction,
        sensor_curvature,
        sensor_play,
        sensor_creep,
        mains_hum,
        sensor_dead_band,
        coarse_digits,
        hinge_detents,
        tendon,
        slick_patch,
        soft_patch,
        shaking_floor,
        hose_at_the_shaft,
    )
}
NAMES = (*STRANGERS, "stiffness_falls_with_repeats")
