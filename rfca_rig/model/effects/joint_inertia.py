"""Reflected inertia of every joint: that of a rotor behind a gear, times the gear ratio squared."""

from typing import Any

from rfca_rig.model.effect import Effect, Parameter, Values
from rfca_rig.model.laws import ROTOR, LawUse
from rfca_rig.model.setup import Setup, with_law


def torque(
    phi: float, rate: float, acceleration: float, elapsed: float, k0: float, k2: float, memory: Any, parameter: Any
) -> tuple[float, float, float, float]:
    return parameter[0] * acceleration, 0.0, 0.0, parameter[0]


def inertia_of(inertia_kg_m2: float, joint: int = -1) -> LawUse:
    """The law on one joint, from 1, or on all."""
    return LawUse(ROTOR, torque, (inertia_kg_m2,), None, joint)


def apply(setup: Setup, values: Values) -> Setup:
    return with_law(setup, inertia_of(values["inertia_kg_m2"]))


EFFECT = Effect(
    id="joint_inertia",
    where="pendulum-like rigs",
    left_out="inertia of the motors' rotors behind their gears",
    law="T = I phi''",
    source="reflected inertia, I = gear ratio^2 rotor inertia; the rotor's spin with the link before it is left out",
    parameters=(Parameter("inertia_kg_m2", 1e-4, 0.3),),
    apply=apply,
)
