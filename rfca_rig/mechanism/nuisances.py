"""The nominal values of a mechanism that may be a little off, and how each changes a plant."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass

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

SENSORS = {"force sensors": "N", "torque sensors": "N m"}  # and their unit


@dataclass(frozen=True)
class NuisanceKind:
    """One key of [known_to].

    Parameters
    ----------
    unit
        Of the value and of its standard uncertainty.
    objects
        What it is a value of: "bodies", "hinges", "slides", "hinge motors", "slide motors" (joints with an actuator), "actuators",
        "force sensors", "torque sensors", "contacts" for one value of all contacts, or "rig" for one value in all.
    shift
        Changes a plant: object by place, value.
    nominal
        The value of a plant, where it must not become negative.
    """

    unit: str
    objects: str
    shift: Change
    nominal: Callable[[Mechanism, int], float] | None = None


def places_of(mechanism: Mechanism, objects: str) -> dict[str, int]:
    """Names and places of the objects that a kind of nuisance parameter belongs to."""
    if objects in ("rig", "contacts"):
        return {"": 0} if objects == "rig" or mechanism.has_contacts else {}
    if objects in SENSORS:
        return {name: place for name, (place, unit) in mechanism.sensor_values.items() if unit == SENSORS[objects]}
    if objects == "bodies":
        return {name: place for place, name in enumerate(mechanism.bodies) if mechanism.model.body_mass[place + 1] > 0.0}
    if objects == "actuators":
        return {name: place for place, name in enumerate(mechanism.actuators)}
    slides, driven = objects.startswith("slide"), objects.endswith("motors")
    joints = enumerate(mechanism.joints)
    return {name: place for place, name in joints if mechanism.is_slide[place] == slides and (mechanism.driven[place] or not driven)}


def _mass(plant: Plant, place: int, share: float) -> None:
    plant.model.body_mass[place + 1] *= 1.0 + share
    _inertia(plant, place, share)


def _inertia(plant: Plant, place: int, share: float) -> None:
    plant.model.body_inertia[place + 1] *= 1.0 + share


def _centre(plant: Plant, place: int, by_m: float) -> None:
    shift_centre(plant, place + 1, by_m)


def _torque_offset(plant: Plant, place: int, by: float) -> None:
    plant.torque_offset[place] += by


def _zero_offset(plant: Plant, place: int, by: float) -> None:
    plant.zero_offset[place] += by


def _gain(plant: Plant, place: int, share: float) -> None:
    plant.command_gain[place] *= 1.0 + share


def _sensor_offset(plant: Plant, place: int, by: float) -> None:
    plant.sensor_offset[place] += by


def _of_contacts(scale: Callable[[Plant, float], None]) -> Change:
    """A change of all contacts by a share, of which a twentieth remains at least."""

    def change(plant: Plant, place: int, share: float) -> None:  # noqa: ARG001
        scale(plant, max(0.05, 1.0 + share))

    return change


def _delay(plant: Plant, place: int, by_s: float) -> None:  # noqa: ARG001
    plant.command_delay_s += by_s


def _of_model(field: str) -> Callable[[Mechanism, int], float]:
    return lambda mechanism, place: float(getattr(mechanism.model, field)[place])


_damping, _dry, _rotor = (_of_model(field) for field in ("dof_damping", "dof_frictionloss", "dof_armature"))

NUISANCES: Mapping[str, NuisanceKind] = {
    "mass_relative": NuisanceKind("", "bodies", _mass),
    "inertia_relative": NuisanceKind("", "bodies", _inertia),
    "centre_of_mass_m": NuisanceKind("m", "bodies", _centre),
    "joint_damping_Nm_s_per_rad": NuisanceKind("N m s/rad", "hinges", add_to("dof_damping", 0.0), _damping),
    "joint_damping_N_s_per_m": NuisanceKind("N s/m", "slides", add_to("dof_damping", 0.0), _damping),
    "joint_friction_Nm": NuisanceKind("N m", "hinges", add_friction, _dry),
    "joint_friction_N": NuisanceKind("N", "slides", add_friction, _dry),
    "rotor_inertia_kg_m2": NuisanceKind("kg m2", "hinge motors", add_to("dof_armature", 0.0), _rotor),
    "rotor_inertia_kg": NuisanceKind("kg", "slide motors", add_to("dof_armature", 0.0), _rotor),
    "torque_offset_Nm": NuisanceKind("N m", "hinge motors", _torque_offset),
    "force_offset_N": NuisanceKind("N", "slide motors", _torque_offset),
    "zero_offset_rad": NuisanceKind("rad", "hinges", _zero_offset),
    "zero_offset_m": NuisanceKind("m", "slides", _zero_offset),
    "command_gain_relative": NuisanceKind("", "actuators", _gain),
    "command_delay_s": NuisanceKind("s", "rig", _delay),
    "sensor_offset_N": NuisanceKind("N", "force sensors", _sensor_offset),
    "sensor_offset_Nm": NuisanceKind("N m", "torque sensors", _sensor_offset),
    "contact_stiffness_relative": NuisanceKind("", "contacts", _of_contacts(scale_contact_stiffness)),
    "contact_damping_relative": NuisanceKind("", "contacts", _of_contacts(scale_contact_damping)),
    "contact_friction_relative": NuisanceKind("", "contacts", _of_contacts(scale_contact_friction)),
}
OF_COMMANDS = ("torque_offset_Nm", "force_offset_N", "command_gain_relative", "command_delay_s")  # without commands they change nothing
