"""Dry friction of every joint, with stick.

A stuck joint yields like a stiff spring with a damper, so that it comes to rest instead of ringing. Both together never exceed the
friction torque, and the spring's anchor is dragged along beyond it.
"""

from typing import Any

from rfca_rig.model.effect import Effect, Parameter, Values
from rfca_rig.model.laws import HINGE, LawUse
from rfca_rig.model.setup import Setup, with_law

PRESLIDING_RAD = 5e-4  # turn before a stuck joint slips: about a count of a joint's encoder
DAMPING_S = 5e-3  # damper over spring: a stuck joint is at rest after some hundredths of a second


def torque(phi: float, rate: float, elapsed: float, k0: float, k2: float, memory: Any, parameter: Any) -> tuple[float, float, float]:
    stiffness = parameter[0] / PRESLIDING_RAD
    stuck = stiffness * (phi - memory[0] + DAMPING_S * rate)
    if stuck > parameter[0]:
        return parameter[0], 0.0, 0.0
    if stuck < -parameter[0]:
        return -parameter[0], 0.0, 0.0
    return stuck, stiffness, stiffness * DAMPING_S


def advance(phi: float, rate: float, elapsed: float, k0: float, k2: float, memory: Any, parameter: Any) -> None:
    memory[0] = min(max(memory[0], phi - PRESLIDING_RAD), phi + PRESLIDING_RAD)


def friction_of(torque_Nm: float, joint: int = -1) -> LawUse:
    """The law on one joint, from 1, or on all."""
    return LawUse(HINGE, torque, (torque_Nm,), advance, joint)


def apply(setup: Setup, values: Values) -> Setup:
    return with_law(setup, friction_of(values["torque_Nm"]))


EFFECT = Effect(
    id="joint_friction",
    where="pendulum-like rigs",
    left_out="dry friction of the joints and their gears",
    law="T = T_c sgn(phi'), stuck below T_c",
    source="Coulomb; presliding as of Dahl, damped as in LuGre (Canudas de Wit et al. 1995)",
    parameters=(Parameter("torque_Nm", 0.005, 1.0),),
    apply=apply,
)
