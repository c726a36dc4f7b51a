"""The law of a catalogue effect at a place as a function of one argument, to be drawn beside a measured law."""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from rfca_rig.model.catalogue import set_up
from rfca_rig.model.effects import hinge_friction, joints
from rfca_rig.model.hinge_springs import bending_torque_Nm
from rfca_rig.model.laws import HINGE, LOAD, NORMAL, SLIP, LawUse
from rfca_rig.model.motion import ramp_to_speed
from rfca_rig.model.parameters import PresentEffect, RigModel
from rfca_rig.model.setup import SensorOutput, Setup

Floats = NDArray[np.float64]

# A law needs a set-up, but its curve does not depend on the height or on the motion.
ANYWHERE_M = 1.0
FAR_BEHIND_RAD = 1e3


def catalogue_curve(rig: RigModel, present: PresentEffect, place: str, argument: str, u: Floats) -> Floats | None:
    """What the effect adds to the law of the model at this place.

    Parameters
    ----------
    rig
        The model; its own effects are ignored.
    present
        The effect with the fitted values.
    place, argument
        As in `rfca_rig.model.tabulated_law`.
    u : (k,)
        Values of the argument.

    Returns
    -------
    (k,) in the unit of a tabulated law there, or None where the effect does nothing at this place by this argument.

    Raises
    ------
    BadInput
        For an effect that is not in the catalogue.
    """
    motion = ramp_to_speed(0.0, 1.0, 0.05, 1.0)
    plain, having = (set_up(replace(rig, effects=effects), ANYWHERE_M, motion) for effects in ((), (present,)))
    if place.startswith(("hinge", "joint")):
        found = _in_hinges(plain, having, argument, u)
    elif place == "floor_friction":
        wanted = SLIP if argument == "slip_m_s" else LOAD
        laws = [_values(use, u) for use in having.laws if use.place == wanted]
        found = np.prod([*laws, np.ones_like(u)], axis=0) - 1.0
    elif place == "floor_normal":
        stiffer = having.rig.ground.stiffness_N_per_m1p5 - plain.rig.ground.stiffness_N_per_m1p5
        found = stiffer * np.maximum(u, 0.0) ** 1.5 + sum(_values(use, u, 0.0) for use in having.laws if use.place == NORMAL)
    else:
        found = _read(having, place, argument, u)
    return found if np.any(found) else None


def _in_hinges(plain: Setup, having: Setup, argument: str, u: Floats) -> Floats:
    """Added torque (k,) in a hinge: dry friction while it slides, a spring while it is bent slowly.

    Other laws with memory are no function of the argument, so they add nothing.
    """
    before, after = plain.rig.leg, having.rig.leg
    if argument == "rate_rad_s":
        slides = sum(
            _sliding(use, u) for use in having.laws if use.law in (hinge_friction.dry_friction_torque, joints.joint_stribeck_torque)
        )
        return np.asarray((after.hinge_damping_Nm_s_per_rad - before.hinge_damping_Nm_s_per_rad) * u + slides)
    if argument != "angle_rad":
        return np.zeros_like(u)
    own = [bending_torque_Nm(leg, u) for leg in (before, after)]
    bent = [
        _values(use, u, 0.0, 0.0, after.k0_Nm_per_rad, after.k2_per_rad2)
        for use in having.laws
        if use.place == HINGE and use.advance is None and use.only == -1
    ]
    return np.asarray(own[1] - own[0] + sum(bent))


def _sliding(use: LawUse, u: Floats) -> Floats:
    """Dry friction at steady rates (k,): the anchor of its stick spring is far behind, so the joint slides."""
    return np.array([use.law(0.0, rate, 0.0, 0.0, 0.0, [-FAR_BEHIND_RAD * np.sign(rate)], use.parameters)[0] for rate in u.tolist()])


def _values(use: LawUse, u: Floats, *others: float) -> Floats:
    parameter = (*use.parameters, *(0.0,) * (8 - len(use.parameters)))
    return np.array([use.law(float(x), *others, [0.0] * 4, parameter)[0] for x in u])


def _read(having: Setup, place: str, argument: str, u: Floats) -> Floats:
    """Added reading (k,), from a sensor that reads zero except for the argument."""
    zero = np.zeros_like(u)
    t_s = u if argument == "time_s" else np.arange(float(len(u)))
    plain = SensorOutput(t_s, zero, zero, zero, u if argument == "shaft_angle_rad" else zero)
    if argument.startswith("reading"):
        channels: dict[str, Floats] = {place: u}
        plain = replace(plain, **channels)
    return np.asarray(getattr(having.apply_sensor_changes(plain), place) - getattr(plain, place))
