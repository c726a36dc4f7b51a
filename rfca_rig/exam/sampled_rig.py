"""The true world of one stroke of a case: nominal rig, differences, scatter between repeats,
effects and their laws.

The catalogue's effects in the exam's simulator: each function adds one effect to a world.

Ids and parameters are those of the catalogue. The laws are independent implementations of the
catalogue's descriptions.
"""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import numpy as np

from rfca_rig.errors import BadInput
from rfca_rig.exam.cases import Case
from rfca_rig.exam.hidden_laws import deform_law, shape_laws, true_world, with_unknown_fault
from rfca_rig.exam.nominal_world import apply_nominal_errors, apply_structured_error, nominal_world
from rfca_rig.exam.simulator.world import World, for_each_hinge

Values = Mapping[str, float]

STIFF_SHAFT_NM_PER_RAD = 2000.0
# Internal damping of a twisted shaft over its stiffness, so large that the shaft does not ring.
SHAFT_RELAXATION_S = 1e-3

# Standard deviations between repeats.
HEIGHT_M = 1e-4
FRICTION = 5e-3
START_RAD = float(np.radians(0.15))


def with_effect(world: World, effect_id: str, values: Values) -> World:
    """The world with one more effect. Raises BadInput for an id that the exam cannot simulate."""
    if effect_id not in EFFECTS:
        raise BadInput(f"the exam has no effect {effect_id!r}; it has {', '.join(EFFECTS)}")
    return EFFECTS[effect_id](world, values)


def hinge_coulomb_friction(world: World, values: Values) -> World:
    return replace(world, hinges=replace(world.hinges, pin_Nm=for_each_hinge(values["torque_Nm"])))


def hinge_viscous_damping(world: World, values: Values) -> World:
    more = tuple(c + values["coefficient_Nm_s_per_rad"] for c in world.hinges.damping_Nm_s_per_rad)
    return replace(world, hinges=replace(world.hinges, damping_Nm_s_per_rad=more))


def hinge_backlash(world: World, values: Values) -> World:
    return replace(
        world,
        hinges=replace(
            world.hinges, gap_rad=for_each_hinge(float(np.radians(values["half_gap_deg"])))
        ),
    )


def hinge_stop(world: World, values: Values) -> World:
    stop = for_each_hinge(float(np.radians(values["angle_deg"])))
    return replace(
        world,
        hinges=replace(
            world.hinges,
            stop_rad=stop,
            stop_Nm_per_rad=for_each_hinge(values["stiffness_Nm_per_rad"]),
        ),
    )


def spring_hysteresis(world: World, values: Values) -> World:
    width = float(np.radians(values["saturation_deg"]))
    torque = tuple(values["strength_relative"] * k0 * width for k0 in world.hinges.k0_Nm_per_rad)
    return replace(
        world, hinges=replace(world.hinges, loop_Nm=torque, loop_rad=for_each_hinge(width))
    )


def spring_relaxation(world: World, values: Values) -> World:
    arm = tuple(values["strength_relative"] * k0 for k0 in world.hinges.k0_Nm_per_rad)
    return replace(
        world,
        hinges=replace(
            world.hinges, arm_Nm_per_rad=arm, arm_s=for_each_hinge(values["time_constant_s"])
        ),
    )


def damaged_hinge(world: World, values: Values) -> World:
    """Hinge 2 is the first behind the shaft."""
    k0 = list(world.hinges.k0_Nm_per_rad)
    k0[round(values["hinge"]) - 2] *= values["stiffness_factor"]
    return replace(world, hinges=replace(world.hinges, k0_Nm_per_rad=tuple(k0)))


def stiffness_hardening(world: World, values: Values) -> World:
    return replace(
        world, hinges=replace(world.hinges, k2_per_rad2=for_each_hinge(values["k2_per_rad2"]))
    )


def hinge_rest_angle(world: World, values: Values) -> World:
    return replace(
        world,
        hinges=replace(
            world.hinges, preset_rad=for_each_hinge(float(np.radians(values["angle_deg"])))
        ),
    )


def hinge_rest_angle_of_one(world: World, values: Values) -> World:
    """Hinge 2 is the first behind the shaft."""
    preset = list(world.hinges.preset_rad)
    preset[round(values["hinge"]) - 2] += float(np.radians(values["angle_deg"]))
    return replace(world, hinges=replace(world.hinges, preset_rad=tuple(preset)))


def tip_mass(world: World, values: Values) -> World:
    return replace(world, links=replace(world.links, tip_mass_kg=1e-3 * values["mass_g"]))


def fluid_drag(world: World, values: Values) -> World:
    return replace(
        world, links=replace(world.links, drag_N_s2_per_m3=values["coefficient_N_s2_per_m3"])
    )


def ground_stribeck(world: World, values: Values) -> World:
    return replace(
        world,
        floor=replace(
            world.floor, stribeck_rise=values["rise_relative"], stribeck_m_s=values["speed_m_s"]
        ),
    )


def ground_compliance(world: World, values: Values) -> World:
    """Two Hertz contacts in series: they carry the same force, and their depths add."""
    yields = sum(
        k ** (-1.0 / world.floor.exponent)
        for k in (world.floor.stiffness, values["stiffness_N_per_m1p5"])
    )
    return replace(world, floor=replace(world.floor, stiffness=yields**-world.floor.exponent))


def ground_tilt(world: World, values: Values) -> World:
    return replace(world, floor=replace(world.floor, slope=values["slope"]))


def ground_adhesion(world: World, values: Values) -> World:
    return replace(world, floor=replace(world.floor, adhesion_N=values["force_N"]))


def motor_speed_droop(world: World, values: Values) -> World:
    kp = values["kp_Nm_s_per_rad"]
    ki = values["ki_Nm_per_rad"]
    return replace(world, drive=replace(world.drive, kp_Nm_s_per_rad=kp, ki_Nm_per_rad=ki))


def motor_speed_ripple(world: World, values: Values) -> World:
    drive = replace(
        world.drive,
        ripple_share=values["amplitude_relative"],
        ripple_cycles=values["cycles_per_turn"],
    )
    return replace(world, drive=drive)


def shaft_compliance(world: World, values: Values) -> World:
    k = values["stiffness_Nm_per_rad"]
    return replace(
        world,
        drive=replace(world.drive, shaft_Nm_per_rad=k, shaft_Nm_s_per_rad=SHAFT_RELAXATION_S * k),
    )


def frame_compliance(world: World, values: Values) -> World:
    mass = values["moving_mass_kg"]
    rate = 2.0 * np.pi * values["frequency_Hz"]
    damping = 2.0 * values["damping_ratio"] * mass * rate
    lean = np.radians(values.get("lean_deg", 0.0))
    felt = values.get("mass_on_sensor_share", 0.0)
    mount = replace(
        world.mount,
        frame_kg=mass,
        frame_N_per_m=mass * rate**2,
        frame_N_s_per_m=damping,
        frame_lean_rad=lean,
    )
    return replace(world, mount=replace(mount, frame_felt_share=felt))


def height_offset(world: World, values: Values) -> World:
    return replace(
        world,
        mount=replace(world.mount, height_m=world.mount.height_m + 1e-3 * values["offset_mm"]),
    )


def gravity_tilt(world: World, values: Values) -> World:
    return replace(world, mount=replace(world.mount, lean_rad=values["angle_rad"]))


def sensor_lag(world: World, values: Values) -> World:
    return replace(world, sensing=replace(world.sensing, lag_s=values["time_constant_s"]))


def clock_offset(world: World, values: Values) -> World:
    return replace(world, sensing=replace(world.sensing, clock_offset_s=values["offset_s"]))


def sensor_crosstalk(world: World, values: Values) -> World:
    return replace(world, sensing=replace(world.sensing, fz_per_fy=values["fz_per_fy"]))


def sensor_drift(world: World, values: Values) -> World:
    return replace(world, sensing=replace(world.sensing, drift_N_per_s=values["rate_N_per_s"]))


def sensor_gain(world: World, values: Values) -> World:
    return replace(world, sensing=replace(world.sensing, gain=values["factor"]))


def hinge_quadratic_damping(world: World, values: Values) -> World:

    quadratic = for_each_hinge(values["coefficient_Nm_s2_per_rad2"])
    return replace(world, hinges=replace(world.hinges, quadratic_Nm_s2_per_rad2=quadratic))


def heavier_link(world: World, values: Values) -> World:
    """Link 1 is at the shaft."""
    mass = list(world.links.mass_kg)
    mass[round(values["link"]) - 1] *= values["mass_factor"]
    return replace(world, links=replace(world.links, mass_kg=tuple(mass)))


def ground_exponent(world: World, values: Values) -> World:
    """Another exponent; the stiffness keeps the force at the depth where it is 20 N."""
    floor = world.floor
    exponent = values["exponent"]
    depth_m = (20.0 / floor.stiffness) ** (1.0 / floor.exponent)
    return replace(
        world, floor=replace(floor, exponent=exponent, stiffness=20.0 / depth_m**exponent)
    )


def sensor_saturation(world: World, values: Values) -> World:
    return replace(world, sensing=replace(world.sensing, clip_N=values["limit_N"]))


def sensor_ringing(world: World, values: Values) -> World:
    sensing = replace(
        world.sensing, ringing_Hz=values["frequency_Hz"], ringing_ratio=values["damping_ratio"]
    )
    return replace(
        world, sensing=replace(sensing, y_frequency_ratio=values.get("y_frequency_ratio", 1.0))
    )


def sensor_clock_rate(world: World, values: Values) -> World:
    return replace(world, sensing=replace(world.sensing, clock_rate=values["rate_relative"]))


def sensor_crosstalk_matrix(world: World, values: Values) -> World:
    sensing = replace(world.sensing, fz_per_fy=values["fz_per_fy"], fy_per_fz=values["fy_per_fz"])
    along = 1e-3 * values["tx_per_fy_mm"]
    down = 1e-3 * values["tx_per_fz_mm"]
    return replace(world, sensing=replace(sensing, tx_per_fy_m=along, tx_per_fz_m=down))


def shaft_friction(world: World, values: Values) -> World:
    return replace(world, drive=replace(world.drive, cable_Nm=values["torque_Nm"]))


def shaft_play(world: World, values: Values) -> World:
    """Stiff on either side of the play."""
    gap_rad = float(np.radians(values["half_gap_deg"]))
    drive = replace(
        world.drive,
        shaft_gap_rad=gap_rad,
        shaft_Nm_per_rad=STIFF_SHAFT_NM_PER_RAD,
        shaft_loss_s_per_rad=0.3,
    )
    return replace(world, drive=drive)


def motor_torque_limit(world: World, values: Values) -> World:
    # A torque limit acts only in a controlled motor, so the drive gets a controller where the
    # values name none.
    kp = values.get("kp_Nm_s_per_rad", 50.0)
    ki = values.get("ki_Nm_per_rad", 1000.0)
    return replace(
        world,
        drive=replace(
            world.drive, kp_Nm_s_per_rad=kp, ki_Nm_per_rad=ki, limit_Nm=values["limit_Nm"]
        ),
    )


def motor_cogging(world: World, values: Values) -> World:
    # Cogging moves the shaft only against a controller of finite stiffness.
    kp = values.get("kp_Nm_s_per_rad", 15.0)
    ki = values.get("ki_Nm_per_rad", 300.0)
    drive = replace(world.drive, kp_Nm_s_per_rad=kp, ki_Nm_per_rad=ki)
    return replace(
        world,
        drive=replace(
            drive, cogging_Nm=values["torque_Nm"], cogging_cycles=values["cycles_per_turn"]
        ),
    )


def ground_bump(world: World, values: Values) -> World:
    height, at, width = (1e-3 * values[name] for name in ("height_mm", "at_mm", "width_mm"))
    return replace(
        world, floor=replace(world.floor, bump_m=height, bump_at_m=at, bump_width_m=width)
    )


def stiffness_fading(world: World, values: Values) -> World:
    """The stiffness falls by the same share for each factor of ten in the number of strokes,
    this one included.
    """
    factor = 10.0 ** (
        math.log10(1.0 - values["loss_per_decade_relative"]) * math.log10(world.strokes_before + 1)
    )
    k0 = tuple(factor * stiffness for stiffness in world.hinges.k0_Nm_per_rad)
    return replace(world, hinges=replace(world.hinges, k0_Nm_per_rad=k0))


EFFECTS: Mapping[str, Callable[[World, Values], World]] = {
    effect.__name__: effect
    for effect in (
        hinge_coulomb_friction,
        hinge_viscous_damping,
        hinge_backlash,
        hinge_stop,
        spring_hysteresis,
        spring_relaxation,
        damaged_hinge,
        stiffness_hardening,
        hinge_rest_angle,
        hinge_rest_angle_of_one,
        tip_mass,
        fluid_drag,
        ground_stribeck,
        ground_compliance,
        ground_tilt,
        ground_adhesion,
        motor_speed_droop,
        motor_speed_ripple,
        shaft_compliance,
        frame_compliance,
        height_offset,
        gravity_tilt,
        sensor_lag,
        clock_offset,
        sensor_crosstalk,
        sensor_drift,
        sensor_gain,
        hinge_quadratic_damping,
        heavier_link,
        ground_exponent,
        sensor_saturation,
        sensor_ringing,
        sensor_clock_rate,
        sensor_crosstalk_matrix,
        shaft_friction,
        shaft_play,
        motor_torque_limit,
        motor_cogging,
        ground_bump,
        stiffness_fading,
    )
}


@dataclass(frozen=True)
class ExamScatter:
    """Differences of one repeat from the mean of all."""

    height_m: float = 0.0
    friction: float = 0.0
    start_rad: float = 0.0


def draw_scatter(random: np.random.Generator) -> ExamScatter:
    """Draw the differences of one repeat: rack height 0.1 mm, friction 0.005, start angle 0.15
    degrees (standard deviations).
    """
    x = random.normal(size=3)
    return ExamScatter(float(HEIGHT_M * x[0]), float(FRICTION * x[1]), float(START_RAD * x[2]))


def build_world(
    case: Case,
    height_m: float,
    scatter: ExamScatter,
    repeat: int,
    stronger: float = 1.0,
    strokes_before: int = 0,
) -> World:
    """The true rig of a case in one repeat (from 1), after `strokes_before` strokes of the
    campaign.

    Effects that vary between conditions are multiplied by `stronger`.
    """
    world = replace(
        apply_nominal_errors(nominal_world(height_m), case.off), strokes_before=strokes_before
    )
    if case.structured is not None:
        world = apply_structured_error(world, case.structured)
    world = replace(world, drive=replace(world.drive, late_s=case.late_s))
    world = true_world(_scatter(world, scatter), case.mislabelled)
    # Laws scale only the damping that an effect adds, so the damping before the effects is kept.
    damping = world.hinges.damping_Nm_s_per_rad
    for effect, values in case.effects.items():
        # Sizes vary between conditions; the speed and angle scales of a law do not.
        world = with_effect(
            world,
            effect,
            {
                name: value if name in ("speed_m_s", "cycles_per_turn") else value * stronger
                for name, value in values.items()
            },
        )
    if case.law is not None:
        world = shape_laws(world, case.law, damping)
    if case.uneven is not None:
        world = deform_law(world, case.uneven, damping)
    for name, values in case.strangers.items():
        world = with_unknown_fault(world, name, values, repeat)
    return world


def _scatter(world: World, scatter: ExamScatter) -> World:
    return replace(
        world,
        floor=replace(world.floor, mu=world.floor.mu + scatter.friction),
        drive=replace(world.drive, start_angle_rad=world.drive.start_angle_rad + scatter.start_rad),
        mount=replace(world.mount, height_m=world.mount.height_m + scatter.height_m),
    )
