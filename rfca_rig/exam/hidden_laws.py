"""Effects that differ from those of the catalogue, so that no case has exactly the model's law.

- Laws are drawn from wider families. The ranges are about those of the literature: Stribeck
  exponents from 0.5 to 2 (Armstrong-Helouvry et al., Automatica 30 (1994) 1083), presliding of a
  pin up to half a degree, and drag exponents around 2.
- Right family, wrong law: effects vary between hinges or conditions, or have another shape.
- Effects outside the catalogue: the right answer to them is "unexplained", never a named effect.
- Labels: campaigns whose metadata or columns are wrong.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from rfca_rig.exam.simulator.world import HINGES, World, for_each_hinge

# Relative standard deviation of an effect's size between hinges.
HINGE_SPREAD = 0.05
HINGE_SIZES = ("pin_Nm", "gap_rad", "stop_Nm_per_rad", "loop_Nm", "arm_Nm_per_rad")

HINGE_EFFECTS = (
    "hinge_coulomb_friction",
    "hinge_viscous_damping",
    "hinge_backlash",
    "hinge_stop",
    "spring_hysteresis",
    "spring_relaxation",
)
VARYING_EFFECTS = (
    "tip_mass",
    "ground_stribeck",
    "ground_adhesion",
    "sensor_crosstalk",
    "sensor_drift",
    "motor_speed_ripple",
)
BENT_EFFECTS = ("ground_compliance", "sensor_gain", "fluid_drag")
TYPICAL_N = 20.0

Values = Mapping[str, float]

Floats = NDArray[np.float64]

# Wrong metadata, with the catalogue effects that describe the same thing and count as right.
MISLABELLED: Mapping[str, tuple[str, ...]] = {
    "links longer than written": (),
    "masses written a fifth too low": (),
    "heights written 8 mm too high": ("height_offset",),
    "fy and fz swapped": (),
    "sign of fy": (),
    "tx in N cm": (),
    "speeds of two conditions swapped": (),
    "start angle written 4 degrees too small": (),
}

# The recorded shaft angle reveals these: a diagnosis that uses it has nothing to explain, so
# "nothing missing" is right.
REVEALED_BY_ENCODER = (
    "speeds of two conditions swapped",
    "start angle written 4 degrees too small",
)


@dataclass(frozen=True)
class Law:
    """Properties that the catalogue fixes or lacks: factors of an effect's size in each hinge (6,),
    and shapes of single laws.

    The pin's friction is full after `pin_creep_deg`. Ground friction falls with the power
    `stribeck_power` of the sliding speed. Adhesion builds up over `adhesion_hold_mm`. Drag grows
    with `drag_power` of the speed. The ripple of the shaft's speed has a phase.
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
    """The world, which has its effects already, with this law; the damping before the effects
    (6,) is not scaled.
    """
    hinges = scale_hinges(world, law.of_hinge, damping_before).hinges
    return replace(
        world,
        hinges=replace(hinges, pin_creep_rad=for_each_hinge(float(np.radians(law.pin_creep_deg)))),
        floor=replace(
            world.floor,
            stribeck_power=law.stribeck_power,
            adhesion_hold_m=1e-3 * law.adhesion_hold_mm,
        ),
        links=replace(world.links, drag_power=law.drag_power),
        drive=replace(world.drive, ripple_phase_rad=law.ripple_phase_rad),
    )


def scale_hinges(
    world: World, of_hinge: tuple[float, ...], damping_before: tuple[float, ...]
) -> World:
    """The world with its effects in each hinge scaled by these factors (6,).

    Of the damping, only what exceeds `damping_before` (6,) belongs to an effect and is scaled.
    """
    hinges = world.hinges
    scaled = {}
    for name in HINGE_SIZES:
        sizes = zip(getattr(hinges, name), of_hinge, strict=True)
        scaled[name] = tuple(size * factor for size, factor in sizes)
    more = zip(hinges.damping_Nm_s_per_rad, damping_before, of_hinge, strict=True)
    damping = tuple(base + (whole - base) * factor for whole, base, factor in more)
    return replace(world, hinges=replace(hinges, **scaled, damping_Nm_s_per_rad=damping))


@dataclass(frozen=True)
class LawDeviation:
    """Deviation of an effect from the catalogue's law.

    - `of_hinge` (6,): factors of the effect in each hinge.
    - `per_condition`: relative standard deviation of its size between conditions.
    - `bent`: another shape, which is a floor of exponent 1.1, a gain with curvature, or drag
      together with quadratic hinge damping.
    - `stribeck_power`: exponent of the speed in friction that falls with it; None for that of the
      case's law.
    """

    effect: str
    of_hinge: tuple[float, ...] = (1.0,) * HINGES
    per_condition: float = 0.0
    bent: bool = False
    stribeck_power: float | None = None


def draw_uneven(i: int, random: np.random.Generator) -> LawDeviation:
    """Draw the deviation of case `i`; the effects take turns."""
    # The stride of 4 mixes hinge effects and others among the first few cases.
    effects = (*HINGE_EFFECTS, *VARYING_EFFECTS, *BENT_EFFECTS)
    effect = effects[4 * i % len(effects)]
    if effect in HINGE_EFFECTS:
        factors = 1.0 + random.uniform(0.3, 0.6) * random.uniform(-1.0, 1.0, HINGES)
        return LawDeviation(effect, of_hinge=tuple(float(x) for x in factors))
    if effect in VARYING_EFFECTS:
        return LawDeviation(effect, per_condition=float(random.uniform(0.1, 0.25)))
    return LawDeviation(effect, bent=True)


def draw_approximate(i: int, random: np.random.Generator) -> LawDeviation:
    """Draw the deviation of case `i`, a law that is wrong by 20 to 40 %; the effects take turns."""
    effects = (*HINGE_EFFECTS, *VARYING_EFFECTS, *BENT_EFFECTS)
    effect = effects[4 * i % len(effects)]
    departure = float(random.uniform(0.2, 0.4))
    if effect in HINGE_EFFECTS:
        # Uniform factors with the departure as their standard deviation: that of a uniform on -1 to
        # 1 is 1 / sqrt(3).
        factors = 1.0 + np.sqrt(3.0) * departure * random.uniform(-1.0, 1.0, HINGES)
        return LawDeviation(
            effect, of_hinge=tuple(float(x) for x in factors), per_condition=0.5 * departure
        )
    if effect in VARYING_EFFECTS:
        return LawDeviation(
            effect, per_condition=departure, stribeck_power=float(random.choice([0.5, 2.0]))
        )
    return LawDeviation(effect, per_condition=0.5 * departure, bent=True)


def deform_law(world: World, uneven: LawDeviation, nominal_damping: tuple[float, ...]) -> World:
    """The world, which has the effect already, with the effect's law changed; `nominal_damping`
    (6,) is not scaled.
    """
    world = scale_hinges(world, uneven.of_hinge, nominal_damping)
    if uneven.stribeck_power is not None:
        world = replace(world, floor=replace(world.floor, stribeck_power=uneven.stribeck_power))
    if uneven.bent:
        return _change_shape(world, uneven.effect)
    return world


def _change_shape(world: World, effect: str) -> World:
    floor = world.floor
    sensing = world.sensing
    hinges = world.hinges
    if effect == "ground_compliance":
        depth = (TYPICAL_N / floor.stiffness) ** (1.0 / floor.exponent)
        # The same force at that depth.
        flatter = floor.stiffness * depth ** (floor.exponent - 1.1)
        return replace(world, floor=replace(floor, exponent=1.1, stiffness=flatter))
    # At 40 N the curvature changes the reading by as much as the gain error does.
    if effect == "sensor_gain":
        return replace(world, sensing=replace(sensing, curvature_per_N=(sensing.gain - 1.0) / 40.0))
    return replace(world, hinges=replace(hinges, quadratic_Nm_s2_per_rad2=(0.003,) * HINGES))


def with_unknown_fault(world: World, name: str, values: Values, repeat: int) -> World:
    """The world with one effect from outside the catalogue, as it is in this repeat (from 1)."""
    if name == "stiffness_falls_with_repeats":
        factor = (1.0 - values["share_per_repeat"]) ** (repeat - 1)
        k0 = tuple(factor * stiffness for stiffness in world.hinges.k0_Nm_per_rad)
        return replace(world, hinges=replace(world.hinges, k0_Nm_per_rad=k0))
    return STRANGERS[name](world, values)


def force_cogging(world: World, values: Values) -> World:
    """A ripple of fz over the shaft angle, in no other channel."""
    sensing = replace(
        world.sensing, cogging_N=values["force_N"], cogging_cycles=values["cycles_per_turn"]
    )
    return replace(world, sensing=sensing)


def hinge_asymmetry(world: World, values: Values) -> World:
    """Hinges that are stiffer in one direction than in the other."""
    return replace(world, hinges=replace(world.hinges, asymmetry=for_each_hinge(values["share"])))


def floor_magnet(world: World, values: Values) -> World:
    """A floor that attracts the tip from afar."""
    return replace(
        world,
        floor=replace(
            world.floor, magnet_N=values["force_N"], magnet_reach_m=1e-3 * values["reach_mm"]
        ),
    )


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
    return replace(
        world, sensing=replace(world.sensing, creep_share=values["share"], creep_s=values["time_s"])
    )


def mains_hum(world: World, values: Values) -> World:
    """Interference of the mains frequency, or of twice that, in fz."""
    return replace(
        world,
        sensing=replace(world.sensing, hum_N=values["amplitude_N"], hum_Hz=values["frequency_Hz"]),
    )


def sensor_dead_band(world: World, values: Values) -> World:
    """Small forces that read zero."""
    return replace(world, sensing=replace(world.sensing, dead_N=values["below_N"]))


def coarse_digits(world: World, values: Values) -> World:
    """A converter of fz with too few digits for its range."""
    return replace(world, sensing=replace(world.sensing, digit_N=values["digit_N"]))


def hinge_detents(world: World, values: Values) -> World:
    """Hinges that snap to even angles, as between magnets."""
    detent = for_each_hinge(values["torque_Nm"])
    per_rad = for_each_hinge(values["per_turn"])
    return replace(world, hinges=replace(world.hinges, detent_Nm=detent, detents_per_rad=per_rad))


def tendon(world: World, values: Values) -> World:
    """An elastic cord along all hinges: its torque on each is proportional to the sum of all
    hinge angles.
    """
    return replace(
        world,
        hinges=replace(
            world.hinges, tendon_Nm_per_rad=for_each_hinge(values["stiffness_Nm_per_rad"])
        ),
    )


def slick_patch(world: World, values: Values) -> World:
    """A patch of the floor with less friction, as where oil has dripped."""
    at = 1e-3 * values["at_mm"]
    width = 1e-3 * values["width_mm"]
    return replace(
        world,
        floor=replace(
            world.floor,
            patch_at_m=at,
            patch_width_m=width,
            patch_mu_factor=values["friction_factor"],
        ),
    )


def soft_patch(world: World, values: Values) -> World:
    """A patch of the floor that is softer, as over a hole under the mat."""
    at = 1e-3 * values["at_mm"]
    width = 1e-3 * values["width_mm"]
    return replace(
        world,
        floor=replace(
            world.floor,
            patch_at_m=at,
            patch_width_m=width,
            patch_stiffness_factor=values["stiffness_factor"],
        ),
    )


def shaking_floor(world: World, values: Values) -> World:
    """A machine next door that shakes the floor."""
    return replace(
        world,
        floor=replace(
            world.floor, shake_m=1e-3 * values["amplitude_mm"], shake_Hz=values["frequency_Hz"]
        ),
    )


def hose_at_the_shaft(world: World, values: Values) -> World:
    """A stiff hose or cable that turns the shaft back to where it started."""
    return replace(
        world, drive=replace(world.drive, hose_Nm_per_rad=values["stiffness_Nm_per_rad"])
    )


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


def true_world(world: World, mislabelled: str | None) -> World:
    """The true world behind a campaign whose file describes another one."""
    links = world.links
    if mislabelled == "links longer than written":
        return replace(
            world, links=replace(links, length_m=tuple(1.05 * length for length in links.length_m))
        )
    if mislabelled == "masses written a fifth too low":
        return replace(
            world, links=replace(links, mass_kg=tuple(1.25 * mass for mass in links.mass_kg))
        )
    if mislabelled == "heights written 8 mm too high":
        return replace(world, mount=replace(world.mount, height_m=world.mount.height_m - 8e-3))
    if mislabelled == "start angle written 4 degrees too small":
        return replace(
            world,
            drive=replace(
                world.drive, start_angle_rad=world.drive.start_angle_rad + float(np.radians(4.0))
            ),
        )
    return world


def columns_as_written(columns: dict[str, Floats], mislabelled: str | None) -> dict[str, Floats]:
    """The columns, (m,) each, under the names and in the units that the faulty logger gave them."""
    if mislabelled == "fy and fz swapped":
        return {**columns, "fy_N": columns["fz_N"], "fz_N": columns["fy_N"]}
    if mislabelled == "sign of fy":
        return {**columns, "fy_N": -columns["fy_N"]}
    if mislabelled == "tx in N cm":
        return {**columns, "tx_Nm": 100.0 * columns["tx_Nm"]}
    return columns


def speed_as_written(speed: float, speeds: tuple[float, ...], mislabelled: str | None) -> float:
    """The speed as the campaign's file states it: lowest and highest change places where they
    were swapped.
    """
    if mislabelled != "speeds of two conditions swapped":
        return speed
    low = min(speeds)
    high = max(speeds)
    return {low: high, high: low}.get(speed, speed)
