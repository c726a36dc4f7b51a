"""Nuisance parameters of a mechanism: the nominal values that may be slightly wrong, and how
each changes a plant.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass

from scipy.spatial.transform import Rotation

from rfca_rig.mechanism.contact_law import DRAG, PRESLIDING
from rfca_rig.mechanism.load import Mechanism
from rfca_rig.mechanism.plant import (
    Change,
    Plant,
    add_friction,
    add_to,
    scale_contact_damping,
    scale_contact_friction,
    scale_contact_stiffness,
    shift_centre,
)

# Share of the total mass. A lighter body has a mass only because MuJoCo requires one.
PLACEHOLDER = 1e-5
# What remains of an inertia about the centre of mass at least: MuJoCo refuses none.
LEAST_SHARE = 1e-6
SENSORS = {"force sensors": "N", "torque sensors": "N m"}  # and their unit


@dataclass(frozen=True)
class NuisanceKind:
    """One key of [known_to].

    Parameters
    ----------
    unit
        Of the value and of its standard uncertainty.
    objects
        Kind of object that has the value: "bodies", "turning bodies" (each on one hinge), "hinges",
        "slides" (joints whose position was recorded), "moving hinges", "moving slides" (joints that
        are not prescribed), "hinge motors", "slide motors" (of these, joints with an actuator),
        "springs" (joints with one),
        "actuators", "force sensors", "torque sensors", or one value for all "contacts", "contact
        laws" (those that have a law of their own), "starts" of motions from rest, or the whole
        "rig".
    shift
        Changes a plant: object by place, value.
    nominal
        The value of a plant, where it must not become negative.
    """

    unit: str
    objects: str
    shift: Change
    nominal: Callable[[Mechanism, int], float] | None = None


def find_places(mechanism: Mechanism, objects: str) -> dict[str, int]:
    """Names and indices of the objects that a kind of nuisance parameter belongs to."""
    of_all = {
        "rig": True,
        "starts": True,
        "contacts": mechanism.has_contacts,
        "contact laws": bool(mechanism.contacts),
    }
    if objects in of_all:
        if of_all[objects]:
            return {"": 0}
        return {}
    if objects in SENSORS:
        return {
            name: index
            for name, (index, unit) in mechanism.sensor_values.items()
            if unit == SENSORS[objects]
        }
    if objects.endswith("bodies"):
        masses = mechanism.model.body_mass[1:]
        heavy = {
            name: index
            for index, name in enumerate(mechanism.bodies)
            if masses[index] > PLACEHOLDER * masses.sum()
        }
        if objects == "bodies":
            return heavy
        return {name: index for name, index in heavy.items() if _turns(mechanism, index)}
    if objects == "actuators":
        return {name: index for index, name in enumerate(mechanism.actuators)}
    names = mechanism.joints
    if objects == "springs":
        return {names[joint]: joint for joint in mechanism.simulated if mechanism.has_spring(joint)}
    # The remaining kinds are joints: "hinges", "moving slides", "hinge motors" and so on.
    slides = "slide" in objects
    driven = objects.endswith("motors")
    read = [joint for joint in range(len(names)) if joint not in mechanism.unmeasured]
    joints = read if objects in ("hinges", "slides") else mechanism.simulated
    return {
        names[joint]: joint
        for joint in joints
        if mechanism.is_slide[joint] == slides and (mechanism.driven[joint] or not driven)
    }


def _turns(mechanism: Mechanism, body: int) -> bool:
    """Whether the body of this place hangs on a single joint, a hinge."""
    joints = mechanism.model.body_jntnum[body + 1]
    return bool(joints == 1 and not mechanism.is_slide[mechanism.model.body_jntadr[body + 1]])


def find_groups(mechanism: Mechanism, objects: str) -> dict[str, tuple[int, ...]]:
    """The same, with objects of the same type together under the name of their group."""
    single = find_places(mechanism, objects)
    groups = {}
    for name, members in mechanism.alike.items():
        if places := tuple(single.pop(member) for member in members if member in single):
            groups[name] = places
    return {**{name: (index,) for name, index in single.items()}, **groups}


# Bodies are counted without the world here, which is body 0 of MuJoCo: hence `body + 1`.
def _mass(plant: Plant, body: int, share: float) -> None:
    plant.model.body_mass[body + 1] *= 1.0 + share
    _inertia(plant, body, share)


def _inertia(plant: Plant, body: int, share: float) -> None:
    plant.model.body_inertia[body + 1] *= 1.0 + share


def _inertia_about_joint(plant: Plant, body: int, share: float) -> None:
    """Scales the inertia of a body about its hinge; mass and centre of mass stay, so that it does
    not fall below that of a point mass.
    """
    model = plant.model
    joint = model.body_jntadr[body + 1]
    axis = model.jnt_axis[joint]
    arm = model.body_ipos[body + 1] - model.jnt_pos[joint]
    # Steiner: the square of the distance between the axis and the centre of mass.
    square = float(arm @ arm - (arm @ axis) ** 2)
    w, x, y, z = model.body_iquat[body + 1]
    # Components of the axis along the principal axes of the body's inertia.
    principal = Rotation.from_quat([x, y, z, w]).inv().apply(axis)
    about_centre = float(model.body_inertia[body + 1] @ principal**2)
    more = share * (about_centre + model.body_mass[body + 1] * square)
    model.body_inertia[body + 1] *= max(LEAST_SHARE, 1.0 + more / about_centre)


def _stiffness(plant: Plant, joint: int, share: float) -> None:
    plant.model.jnt_stiffness[joint] *= 1.0 + share
    plant.model.jnt_stiffnesspoly[joint] *= 1.0 + share


def _law(column: int) -> Change:
    """A relative change of one number of all contacts that have a law of their own; at least a
    twentieth of it remains.
    """

    # A fit may try shares below -1, and a stiffness of zero or less cannot be simulated.
    def change(plant: Plant, place: int, share: float) -> None:  # noqa: ARG001
        plant.contact_law[:, column] *= max(0.05, 1.0 + share)

    return change


def _centre(plant: Plant, body: int, by_m: float) -> None:
    shift_centre(plant, body + 1, by_m)


def _torque_offset(plant: Plant, joint: int, by: float) -> None:
    plant.torque_offset[joint] += by


def _zero_offset(plant: Plant, joint: int, by: float) -> None:
    plant.zero_offset[joint] += by


def _gain(plant: Plant, actuator: int, share: float) -> None:
    plant.command_gain[actuator] *= 1.0 + share


def _sensor_offset(plant: Plant, sensor: int, by: float) -> None:
    plant.sensor_offset[sensor] += by


def _of_contacts(scale: Callable[[Plant, float], None]) -> Change:
    """A relative change of all contacts; at least a twentieth of the value remains, as in
    `_law`.
    """

    def change(plant: Plant, place: int, share: float) -> None:  # noqa: ARG001
        scale(plant, max(0.05, 1.0 + share))

    return change


def _swing(plant: Plant, place: int, share: float) -> None:  # noqa: ARG001
    plant.start_swing += share


def _swing_rate(plant: Plant, place: int, by_per_s: float) -> None:  # noqa: ARG001
    plant.start_swing_rate_per_s += by_per_s


def _delay(plant: Plant, place: int, by_s: float) -> None:  # noqa: ARG001
    plant.command_delay_s += by_s


def _of_model(field: str) -> Callable[[Mechanism, int], float]:
    return lambda mechanism, index: float(getattr(mechanism.model, field)[index])


_damping, _dry, _rotor = (
    _of_model(field) for field in ("dof_damping", "dof_frictionloss", "dof_armature")
)

NUISANCES: Mapping[str, NuisanceKind] = {
    "mass_relative": NuisanceKind("", "bodies", _mass),
    "inertia_relative": NuisanceKind("", "bodies", _inertia),
    "inertia_about_joint_relative": NuisanceKind("", "turning bodies", _inertia_about_joint),
    "centre_of_mass_m": NuisanceKind("m", "bodies", _centre),
    "joint_stiffness_relative": NuisanceKind("", "springs", _stiffness),
    "joint_damping_Nm_s_per_rad": NuisanceKind(
        "N m s/rad", "moving hinges", add_to("dof_damping", 0.0), _damping
    ),
    "joint_damping_N_s_per_m": NuisanceKind(
        "N s/m", "moving slides", add_to("dof_damping", 0.0), _damping
    ),
    "joint_friction_Nm": NuisanceKind("N m", "moving hinges", add_friction, _dry),
    "joint_friction_N": NuisanceKind("N", "moving slides", add_friction, _dry),
    "rotor_inertia_kg_m2": NuisanceKind(
        "kg m2", "hinge motors", add_to("dof_armature", 0.0), _rotor
    ),
    "rotor_inertia_kg": NuisanceKind("kg", "slide motors", add_to("dof_armature", 0.0), _rotor),
    "torque_offset_Nm": NuisanceKind("N m", "hinge motors", _torque_offset),
    "force_offset_N": NuisanceKind("N", "slide motors", _torque_offset),
    "zero_offset_rad": NuisanceKind("rad", "hinges", _zero_offset),
    "zero_offset_m": NuisanceKind("m", "slides", _zero_offset),
    "command_gain_relative": NuisanceKind("", "actuators", _gain),
    "command_delay_s": NuisanceKind("s", "rig", _delay),
    "sensor_offset_N": NuisanceKind("N", "force sensors", _sensor_offset),
    "sensor_offset_Nm": NuisanceKind("N m", "torque sensors", _sensor_offset),
    "start_swing_relative": NuisanceKind("", "starts", _swing),
    "start_swing_rate_per_s": NuisanceKind("1/s", "starts", _swing_rate),
    "contact_stiffness_relative": NuisanceKind(
        "", "contacts", _of_contacts(scale_contact_stiffness)
    ),
    "contact_damping_relative": NuisanceKind("", "contacts", _of_contacts(scale_contact_damping)),
    "contact_friction_relative": NuisanceKind("", "contacts", _of_contacts(scale_contact_friction)),
    "contact_presliding_relative": NuisanceKind("", "contact laws", _law(PRESLIDING)),
    "contact_drag_relative": NuisanceKind("", "contact laws", _law(DRAG)),
}
START_NUISANCES = (
    "start_swing_relative",
    "start_swing_rate_per_s",
)  # of motions that start at rest
# Without recorded commands these change nothing.
COMMAND_NUISANCES = (
    "torque_offset_Nm",
    "force_offset_N",
    "command_gain_relative",
    "command_delay_s",
)
# Zeros and starts of every day of recordings: encoders are referenced and sensors tared again.
NUISANCES_OF_A_DAY = (
    "zero_offset_rad",
    "zero_offset_m",
    "sensor_offset_N",
    "sensor_offset_Nm",
    *START_NUISANCES,
)
