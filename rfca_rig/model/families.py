"""Families of effects: what a diagnosis can state where the data do not distinguish one law from another.

An effect may belong to several families: hysteresis both dissipates energy and has memory. A family has one place.
"""

from collections.abc import Iterable
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
        Where it acts: hinges, tip, ground, drive, rig, surroundings, sensor, or joints or bodies of a pendulum or mechanism.
    members
        Ids of effects, of the catalogue and of mechanisms.
    """

    id: str
    words: str
    place: str
    members: frozenset[str]


FAMILIES = (
    Family(
        "hinge_dissipation",
        "the hinges dissipate energy: friction, damping or hysteresis",
        "hinges",
        frozenset(("hinge_coulomb_friction", "hinge_viscous_damping", "hinge_quadratic_damping", "spring_hysteresis", "spring_relaxation")),
    ),
    Family(
        "spring_memory",
        "the spring remembers how it was bent: hysteresis, relaxation or dry friction in the hinges",
        "hinges",
        frozenset(("spring_hysteresis", "spring_relaxation", "hinge_coulomb_friction")),
    ),
    Family(
        "hinge_stiffness",
        "the torque of the hinges over their angle differs: play, stop, a softer hinge, another hardening or rest angle, or fading",
        "hinges",
        frozenset(
            (
                "hinge_backlash",
                "hinge_stop",
                "damaged_hinge",
                "stiffness_hardening",
                "stiffness_fading",
                "hinge_rest_angle",
                "hinge_rest_angle_of_one",
            )
        ),
    ),
    Family("leg_mass", "mass sits elsewhere on the leg", "tip", frozenset(("tip_mass", "heavier_link", "added_mass"))),
    Family("floor_friction", "floor friction differs, or is not constant", "ground", frozenset(("ground_stribeck", "contact_friction"))),
    Family(
        "floor_yields",
        "the floor or what carries it yields",
        "ground",
        frozenset(("ground_compliance", "ground_exponent", "frame_compliance")),
    ),
    Family(
        "contact_compliance",
        "the contacts yield, or lose energy, otherwise than in the model",
        "ground",
        frozenset(("contact_stiffness", "contact_damping", "contact_power")),
    ),
    Family("floor_holds", "the floor holds the leg back when it leaves", "ground", frozenset(("ground_adhesion",))),
    Family(
        "floor_geometry",
        "the floor is elsewhere than stated: height, slope or a bump",
        "ground",
        frozenset(("height_offset", "ground_tilt", "ground_bump", "prescribed_offset")),
    ),
    Family("rig_tilt", "the rig is not plumb", "rig", frozenset(("gravity_tilt",))),
    Family("rig_yields", "the frame under the shaft yields", "rig", frozenset(("frame_compliance",))),
    Family(
        "drive_yields",
        "the shaft does not turn as commanded: the drive or its coupling yields",
        "drive",
        frozenset(("motor_speed_droop", "motor_torque_limit", "shaft_compliance", "shaft_play")),
    ),
    Family("shaft_friction", "something drags at the shaft", "shaft", frozenset(("shaft_friction",))),
    Family("drive_ripple", "the speed of the shaft varies with its angle", "drive", frozenset(("motor_cogging", "motor_speed_ripple"))),
    Family("air_drag", "the surroundings resist the motion", "surroundings", frozenset(("fluid_drag",))),
    Family(
        "sensor_late",
        "the sensor is late: a filter, a delay or its own swing",
        "sensor",
        frozenset(("sensor_lag", "sensor_ringing", "clock_offset", "sensor_clock_rate")),
    ),
    Family(
        "sensor_scale",
        "the scale of the sensor is wrong: gain, crosstalk or saturation",
        "sensor",
        frozenset(("sensor_gain", "sensor_gain_of_one", "sensor_crosstalk", "sensor_crosstalk_matrix", "sensor_saturation")),
    ),
    Family("sensor_zero", "the zero of the force sensor moves", "sensor", frozenset(("sensor_drift",))),
    Family(
        "joint_dissipation",
        "the joints dissipate energy: dry, viscous or load-dependent friction",
        "joints",
        frozenset(
            (
                *("joint_friction", "joint_friction_of_one", "joint_stribeck", "joint_load_friction", "joint_load_friction_of_one"),
                *("joint_damping", "joint_damping_of_one", "joint_drag", "joint_drag_of_one", "hinge_viscous_damping", "fluid_drag"),
                "joint_hysteresis",
            )
        ),
    ),
    Family("joint_inertia", "the joints carry more inertia", "joints", frozenset(("joint_inertia", "joint_inertia_of_one", "added_mass"))),
    Family(
        "joint_stiffness",
        "a spring or a stop acts in the joints",
        "joints",
        frozenset(("joint_spring", "joint_spring_of_one", "joint_stop", "joint_hysteresis")),
    ),
    Family(
        "gear_yields",
        "the gears yield between motor and joint: elasticity or play",
        "joints",
        frozenset(("gear_compliance", "gear_compliance_of_one", "gear_backlash", "gear_backlash_of_one")),
    ),
    Family("body_mass", "the mass of a body differs, or sits elsewhere", "bodies", frozenset(("added_mass", "centre_of_mass"))),
    Family(
        "torque_scale",
        "the torque is not what was recorded",
        "joints",
        frozenset(
            (
                *("torque_scale", "torque_scale_of_one", "torque_lag", "torque_delay", "torque_saturation", "torque_dead_band"),
                *("torque_falls_with_speed", "clock_rate"),
            )
        ),
    ),
)


def families_of(effect_id: str) -> tuple[Family, ...]:
    """The families that an effect belongs to; a lab's own effect is a family of its own."""
    families = tuple(family for family in FAMILIES if effect_id in family.members)
    return families or (Family(effect_id, effect_id.replace("_", " "), "", frozenset((effect_id,))),)


def members_of(family_id: str) -> frozenset[str]:
    """The effects of a family; a lab's own effect is the only one of its own."""
    return next((family.members for family in FAMILIES if family.id == family_id), frozenset((family_id,)))


def list_related(ids: Iterable[str]) -> frozenset[str]:
    """All members of the families of these effects, themselves among them."""
    return frozenset().union(*(family.members for effect in ids for family in families_of(effect)))
