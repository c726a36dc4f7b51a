"""The law at a place as the recordings show it, beside the law that the catalogue has there."""

from collections.abc import Collection

import numpy as np
from numpy.typing import NDArray

from rfca_rig.diagnosis.inference.hypotheses import Hypothesis, ModelSelectionResult
from rfca_rig.diagnosis.residual_force.catalogue_curve import catalogue_curve
from rfca_rig.diagnosis.residual_force.law import CatalogueCurve, StatedLaw
from rfca_rig.diagnosis.residual_force.measured_law import LawStart, base_without, measure_law
from rfca_rig.errors import BadInput
from rfca_rig.model.catalogue import families_of

Floats = NDArray[np.float64]

OF_LEG = ("hinges", "floor_friction", "floor_normal", "fy_N", "fz_N", "tx_Nm")
OF_PENDULUM = ("joints", "joint1", "joint2")
CURVE_POINTS = 200

# Families whose members are a law at the place: beside one of them the residual force there would be what that law leaves.
FAMILIES_AT = {
    "hinges": ("hinge_dissipation", "spring_memory", "hinge_stiffness"),
    "floor_friction": ("floor_friction",),
    "floor_normal": ("floor_yields", "floor_holds"),
    "joint": ("joint_dissipation",),
    "channel": ("sensor_scale", "sensor_zero"),
}


def check_place(place: str, known: Collection[str]) -> None:
    """Raise BadInput for a place where no law can be measured on this kind of rig."""
    if place not in known:
        raise BadInput(f"--law {place}: no law can be measured there; name one of {', '.join(known)}")


def measure_stated_law(found: ModelSelectionResult, hypothesis: Hypothesis, place: str) -> StatedLaw:
    """Measure the law at a place beside the rest of a hypothesis. Its effects that act there are left out.

    Parameters
    ----------
    found
        The result of a search.
    hypothesis
        What is stated; `found.nothing` where nothing is.
    place
        One of OF_LEG or OF_PENDULUM, after the kind of rig.

    Raises
    ------
    BadInput
        Where no recording moves.
    SimulationFailed
        Where the model has no answer with any law there.
    """
    coordinates, mean = hypothesis.fitted.coordinates, hypothesis.marginal.posterior.mean
    numbers = [number for number, name in enumerate(hypothesis.ids) if _acts_at(name, place)]
    base = hypothesis
    for number in numbers:
        base = base_without(found, base, hypothesis.ids[number])
    of_acting = [index for number in numbers for index in range(coordinates.size)[coordinates.part(number)]]
    rig = coordinates.supposed(mean).rig
    acting = {hypothesis.ids[number]: coordinates.choices[number].present(mean[coordinates.part(number)]) for number in numbers}

    def curves(argument: str, u: Floats) -> dict[str, Floats]:
        found_curves = {name: catalogue_curve(rig, present, place, argument, u) for name, present in acting.items()}
        return {name: curve for name, curve in found_curves.items() if curve is not None}

    def values(argument: str, u: Floats) -> Floats | None:
        return np.asarray(sum(known)) if (known := list(curves(argument, u).values())) else None

    # The fitted law of the catalogue is a good start, but only one of several.
    law = measure_law(found, place, base, start=LawStart(np.delete(mean, of_acting), values) if acting else None)
    u = np.linspace(*law.visited, CURVE_POINTS)
    drawn = next((CatalogueCurve(name, u, curve) for name, curve in curves(law.argument, u).items()), None)
    return StatedLaw(law, tuple(acting), drawn)


def _acts_at(effect_id: str, place: str) -> bool:
    kind = "joint" if place in OF_PENDULUM else place if place in FAMILIES_AT else "channel"
    return any(family.id in FAMILIES_AT[kind] for family in families_of(effect_id))
