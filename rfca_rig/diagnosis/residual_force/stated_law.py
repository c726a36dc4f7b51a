"""The law at a place as the recordings show it, beside the law that the catalogue has there as a
function of the same argument.
"""

from collections.abc import Collection
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from rfca_rig.diagnosis.inference.hypotheses import Hypothesis, ModelSelectionResult
from rfca_rig.diagnosis.residual_force.law import CatalogueCurve, StatedLaw
from rfca_rig.diagnosis.residual_force.measured_law import LawStart, base_without, measure_law
from rfca_rig.errors import BadInput
from rfca_rig.model.catalogue import families_of, set_up
from rfca_rig.model.effects import hinge_friction
from rfca_rig.model.hinge_springs import bending_torque_Nm
from rfca_rig.model.kernel.laws import HINGE, LOAD, NORMAL, SLIP, LawUse
from rfca_rig.model.motion import ramp_to_speed
from rfca_rig.model.parameters import PresentEffect, RigModel
from rfca_rig.model.setup import SensorOutput, Setup

Floats = NDArray[np.float64]

# A law needs a set-up, but its curve does not depend on the height or on the motion.
ANYWHERE_M = 1.0
FAR_BEHIND_RAD = 1e3

OF_LEG = ("hinges", "floor_friction", "floor_normal", "fy_N", "fz_N", "tx_Nm")
CURVE_POINTS = 200

# Families whose members are a law at the place: beside one of them the residual force there would
# be what that law leaves.
FAMILIES_AT = {
    "hinges": ("hinge_dissipation", "spring_memory", "hinge_stiffness"),
    "floor_friction": ("floor_friction",),
    "floor_normal": ("floor_yields", "floor_holds"),
    "channel": ("sensor_scale", "sensor_zero"),
}


def catalogue_curve(
    rig: RigModel, present: PresentEffect, place: str, argument: str, u: Floats
) -> Floats | None:
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
    (k,) in the unit of a tabulated law there, or None where the effect does nothing at this place
    by this argument.

    Raises
    ------
    BadInput
        For an effect that is not in the catalogue.
    """
    motion = ramp_to_speed(0.0, 1.0, 0.05, 1.0)
    plain, having = (
        set_up(replace(rig, effects=effects), ANYWHERE_M, motion) for effects in ((), (present,))
    )
    if place.startswith("hinge"):
        curve = _in_hinges(plain, having, argument, u)
    elif place == "floor_friction":
        wanted = SLIP if argument == "slip_m_s" else LOAD
        laws = [_values(use, u) for use in having.laws if use.place == wanted]
        curve = np.prod([*laws, np.ones_like(u)], axis=0) - 1.0
    elif place == "floor_normal":
        stiffer = having.rig.ground.stiffness_N_per_m1p5 - plain.rig.ground.stiffness_N_per_m1p5
        curve = stiffer * np.maximum(u, 0.0) ** 1.5 + sum(
            _values(use, u, 0.0) for use in having.laws if use.place == NORMAL
        )
    else:
        curve = _read(having, place, argument, u)
    if np.any(curve):
        return curve
    return None


def _in_hinges(plain: Setup, having: Setup, argument: str, u: Floats) -> Floats:
    """Added torque (k,) in a hinge: dry friction while it slides, a spring while it is bent slowly.

    Other laws with memory are no function of the argument, so they add nothing.
    """
    before = plain.rig.leg
    after = having.rig.leg
    if argument == "rate_rad_s":
        slides = sum(
            _sliding(use, u) for use in having.laws if use.law is hinge_friction.dry_friction_torque
        )
        return np.asarray(
            (after.hinge_damping_Nm_s_per_rad - before.hinge_damping_Nm_s_per_rad) * u + slides
        )
    if argument != "angle_rad":
        return np.zeros_like(u)
    torques = [bending_torque_Nm(leg, u) for leg in (before, after)]
    bent = [
        _values(use, u, 0.0, 0.0, after.k0_Nm_per_rad, after.k2_per_rad2)
        for use in having.laws
        if use.place == HINGE and use.advance is None and use.only == -1
    ]
    return np.asarray(torques[1] - torques[0] + sum(bent))


def _sliding(use: LawUse, u: Floats) -> Floats:
    """Dry friction at steady rates (k,): the anchor of its stick spring is far behind, so the
    joint slides.
    """
    return np.array(
        [
            use.law(0.0, rate, 0.0, 0.0, 0.0, [-FAR_BEHIND_RAD * np.sign(rate)], use.parameters)[0]
            for rate in u.tolist()
        ]
    )


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


def check_place(place: str, known: Collection[str]) -> None:
    """Raise BadInput for a place where no law can be measured on this kind of rig."""
    if place not in known:
        raise BadInput(
            f"--law {place}: no law can be measured there; name one of {', '.join(known)}"
        )


def measure_stated_law(
    found: ModelSelectionResult, hypothesis: Hypothesis, place: str
) -> StatedLaw:
    """Measure the law at a place beside the rest of a hypothesis. Its effects that act there are
    left out.

    Parameters
    ----------
    found
        The result of a search.
    hypothesis
        What is stated; `found.nothing` where nothing is.
    place
        One of OF_LEG.

    Raises
    ------
    BadInput
        Where no recording moves.
    SimulationFailed
        Where the model has no answer with any law there.
    """
    coordinates = hypothesis.fitted.coordinates
    mean = hypothesis.marginal.posterior.mean
    numbers = [number for number, name in enumerate(hypothesis.ids) if _acts_at(name, place)]
    base = hypothesis
    for number in numbers:
        base = base_without(found, base, hypothesis.ids[number])
    of_acting = [
        index for number in numbers for index in range(coordinates.size)[coordinates.part(number)]
    ]
    rig = coordinates.supposed(mean).rig
    acting = {
        hypothesis.ids[number]: coordinates.choices[number].present(mean[coordinates.part(number)])
        for number in numbers
    }

    def curves(argument: str, u: Floats) -> dict[str, Floats]:
        found_curves = {
            name: catalogue_curve(rig, present, place, argument, u)
            for name, present in acting.items()
        }
        return {name: curve for name, curve in found_curves.items() if curve is not None}

    def values(argument: str, u: Floats) -> Floats | None:
        if known := list(curves(argument, u).values()):
            return np.asarray(sum(known))
        return None

    # The fitted law of the catalogue is a good start, but only one of several.
    law = measure_law(
        found, place, base, start=LawStart(np.delete(mean, of_acting), values) if acting else None
    )
    u = np.linspace(*law.visited, CURVE_POINTS)
    drawn = next(
        (CatalogueCurve(name, u, curve) for name, curve in curves(law.argument, u).items()), None
    )
    return StatedLaw(law, tuple(acting), drawn)


def _acts_at(effect_id: str, place: str) -> bool:
    kind = place if place in FAMILIES_AT else "channel"
    return any(family.id in FAMILIES_AT[kind] for family in families_of(effect_id))
