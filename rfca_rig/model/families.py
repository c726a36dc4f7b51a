"""Families of effects that are hard to tell apart.

An effect declares the families to which it belongs: hysteresis both dissipates energy and has
memory.
"""

from dataclasses import dataclass


@dataclass(frozen=True)
class Family:
    """Effects that act alike.

    Parameters
    ----------
    id
        Its name in diagnosis.json.
    words
        What is missing, in an engineer's words.
    place
        Where it acts: hinges, tip, ground, drive, rig, surroundings, sensor, or joints or bodies of
        a pendulum or mechanism.
    """

    id: str
    words: str
    place: str


# Families that the search and the decision refer to.
DRY = "joint_dry_loss"
RISING_WITH_SPEED = "joint_loss_with_speed"

FAMILIES = (
    Family(
        "hinge_dissipation",
        "the hinges dissipate energy: friction, damping or hysteresis",
        "hinges",
    ),
    Family(
        "spring_memory",
        (
            "the spring remembers how it was bent: hysteresis, relaxation or dry friction in "
            "the hinges"
        ),
        "hinges",
    ),
    Family(
        "hinge_stiffness",
        (
            "the torque of the hinges over their angle differs: play, stop, a softer hinge, "
            "another hardening or rest angle, or fading"
        ),
        "hinges",
    ),
    Family("leg_mass", "mass sits elsewhere on the leg", "tip"),
    Family("floor_friction", "floor friction differs, or is not constant", "ground"),
    Family("floor_yields", "the floor or what carries it yields", "ground"),
    Family(
        "contact_compliance",
        "the contacts yield, or lose energy, otherwise than in the model",
        "ground",
    ),
    Family("floor_holds", "the floor holds the leg back when it leaves", "ground"),
    Family(
        "floor_geometry", "the floor is elsewhere than stated: height, slope or a bump", "ground"
    ),
    Family("rig_tilt", "the rig is not plumb", "rig"),
    Family("rig_yields", "the frame under the shaft yields", "rig"),
    Family(
        "drive_yields",
        "the shaft does not turn as commanded: the drive or its coupling yields",
        "drive",
    ),
    Family("shaft_friction", "something drags at the shaft", "shaft"),
    Family("drive_ripple", "the speed of the shaft varies with its angle", "drive"),
    Family("air_drag", "the surroundings resist the motion", "surroundings"),
    Family("sensor_late", "the sensor is late: a filter, a delay or its own swing", "sensor"),
    Family(
        "sensor_scale", "the scale of the sensor is wrong: gain, crosstalk or saturation", "sensor"
    ),
    Family("sensor_zero", "the zero of the force sensor moves", "sensor"),
    Family(
        "joint_dissipation",
        "the joints dissipate energy: dry, viscous or load-dependent friction",
        "joints",
    ),
    Family(
        DRY,
        "the joints lose torque that hardly depends on their speed: dry or load-dependent friction",
        "joints",
    ),
    Family(
        RISING_WITH_SPEED,
        "the joints lose torque that rises with their speed: damping or drag",
        "joints",
    ),
    Family(
        "joint_position_torque",
        "a torque that follows the position differs: a weight, its lever, a spring or a tilt",
        "joints",
    ),
    Family("joint_inertia", "the joints carry more inertia", "joints"),
    Family("joint_stiffness", "a spring or a stop acts in the joints", "joints"),
    Family("gear_yields", "the gears yield between motor and joint: elasticity or play", "joints"),
    Family("body_mass", "the mass of a body differs, or sits elsewhere", "bodies"),
    Family("torque_scale", "the torque is not what was recorded", "joints"),
)

_WEIGHT = ("joint_position_torque", "joint_inertia", "body_mass")
_LOSS = ("joint_dissipation",)
# Families whose effects act much as an error of a nominal value does, by the name of the value
# without that of its joint, body or actuator.
FAMILIES_OF_VALUES = {
    "mass_relative": _WEIGHT,
    "centre_of_mass_m": _WEIGHT,
    "inertia_relative": _WEIGHT,
    "inertia_about_joint_relative": _WEIGHT,
    "rotor_inertia_kg_m2": ("joint_inertia",),
    "zero_offset_rad": ("joint_position_torque",),
    "zero_offset_m": ("joint_position_torque",),
    "torque_offset_Nm": ("joint_position_torque", "torque_scale"),
    "joint_damping_Nm_s_per_rad": _LOSS,
    "joint_damping_N_s_per_m": _LOSS,
    "joint_friction_Nm": _LOSS,
    "joint_friction_N": _LOSS,
    "command_gain_relative": ("torque_scale",),
    "command_delay_s": ("torque_scale", "joint_inertia"),
    "torque_delay_s": ("torque_scale", "joint_inertia"),
    "contact_stiffness_relative": ("contact_compliance",),
    "contact_damping_relative": ("contact_compliance",),
    "k0": ("hinge_stiffness",),
    "k2": ("hinge_stiffness",),
    "hinge_damping": ("hinge_dissipation",),
    "mass": ("leg_mass",),
    "height": ("floor_geometry",),
    "friction": ("floor_friction",),
    "presliding": ("floor_friction",),
    "tangential_damping": ("floor_friction",),
    "friction_rise": ("floor_friction",),
    "contact_stiffness": ("floor_yields",),
    "command_delay": ("drive_yields", "sensor_late"),
}
