"""Right family, wrong law: effects that vary between hinges or conditions, or have another shape than the catalogue's."""

from dataclasses import dataclass, replace

import numpy as np

from rfca_rig.exam.laws import scale_hinges
from rfca_rig.exam.world import HINGES, World

HINGE_EFFECTS = (
    "hinge_coulomb_friction",
    "hinge_viscous_damping",
    "hinge_backlash",
    "hinge_stop",
    "spring_hysteresis",
    "spring_relaxation",
)
VARYING_EFFECTS = ("tip_mass", "ground_stribeck", "ground_adhesion", "sensor_crosstalk", "sensor_drift", "motor_speed_ripple")
BENT_EFFECTS = ("ground_compliance", "sensor_gain", "fluid_drag")
TYPICAL_N = 20.0


@dataclass(frozen=True)
class LawDeviation:
    """Deviation of an effect from the catalogue's law.

    - `of_hinge` (6,): factors of the effect in each hinge.
    - `per_condition`: relative standard deviation of its size between conditions.
    - `bent`: another shape, which is a floor of exponent 1.1, a gain with curvature, or drag together with quadratic hinge damping.
    - `stribeck_power`: exponent of the speed in friction that falls with it; None for that of the case's law.
    """

    effect: str
    of_hinge: tuple[float, ...] = (1.0,) * HINGES
    per_condition: float = 0.0
    bent: bool = False
    stribeck_power: float | None = None


def draw_uneven(i: int, random: np.random.Generator) -> LawDeviation:
    """Draw the deviation of case `i`; the effects take turns."""
    # The stride of 4 mixes hinge effects and others among the first few cases.
    every = (*HINGE_EFFECTS, *VARYING_EFFECTS, *BENT_EFFECTS)
    effect = every[4 * i % len(every)]
    if effect in HINGE_EFFECTS:
        factors = 1.0 + random.uniform(0.3, 0.6) * random.uniform(-1.0, 1.0, HINGES)
        return LawDeviation(effect, of_hinge=tuple(float(x) for x in factors))
    if effect in VARYING_EFFECTS:
        return LawDeviation(effect, per_condition=float(random.uniform(0.1, 0.25)))
    return LawDeviation(effect, bent=True)


def draw_approximate(i: int, random: np.random.Generator) -> LawDeviation:
    """Draw the deviation of case `i`, a law that is wrong by 20 to 40 %; the effects take turns."""
    every = (*HINGE_EFFECTS, *VARYING_EFFECTS, *BENT_EFFECTS)
    effect, departure = every[4 * i % len(every)], float(random.uniform(0.2, 0.4))
    if effect in HINGE_EFFECTS:
        # Uniform factors with the departure as their standard deviation: that of a uniform on -1 to 1 is 1 / sqrt(3).
        factors = 1.0 + np.sqrt(3.0) * departure * random.uniform(-1.0, 1.0, HINGES)
        return LawDeviation(effect, of_hinge=tuple(float(x) for x in factors), per_condition=0.5 * departure)
    if effect in VARYING_EFFECTS:
        return LawDeviation(effect, per_condition=departure, stribeck_power=float(random.choice([0.5, 2.0])))
    return LawDeviation(effect, per_condition=0.5 * departure, bent=True)


def deform_law(world: World, uneven: LawDeviation, nominal_damping: tuple[float, ...]) -> World:
    """The world, which has the effect already, with the effect's law changed; `nominal_damping` (6,) is not scaled."""
    world = scale_hinges(world, uneven.of_hinge, nominal_damping)
    if uneven.stribeck_power is not None:
        world = replace(world, floor=replace(world.floor, stribeck_power=uneven.stribeck_power))
    return _change_shape(world, uneven.effect) if uneven.bent else world


def _change_shape(world: World, effect: str) -> World:
    floor, sensing, hinges = world.floor, world.sensing, world.hinges
    if effect == "ground_compliance":
        depth = (TYPICAL_N / floor.stiffness) ** (1.0 / floor.exponent)
        # The same force at that depth.
        flatter = floor.stiffness * depth ** (floor.exponent - 1.1)
        return replace(world, floor=replace(floor, exponent=1.1, stiffness=flatter))
    # At 40 N the curvature changes the reading by as much as the gain error does.
    if effect == "sensor_gain":
        return replace(world, sensing=replace(sensing, curvature_per_N=(sensing.gain - 1.0) / 40.0))
    return replace(world, hinges=replace(hinges, quadratic_Nm_s2_per_rad2=(0.003,) * HINGES))
