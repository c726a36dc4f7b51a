"""Dry friction of the hinge pins, with stick: a stiff spring to an anchor that is dragged along beyond the friction torque."""

from typing import Any

from rfca_rig.model.effect import Effect, Parameter, Values
from rfca_rig.model.laws import HINGE, LawUse
from rfca_rig.model.setup import Setup, with_law

PRESLIDING_RAD = 1e-3  # turn before a stuck pin slips: far below what a photo resolves


def torque(phi: float, rate: float, elapsed: float, k0: float, k2: float, memory: Any, parameter: Any) -> tuple[float, float, float]:
    stiffness = parameter[0] / PRESLIDING_RAD
    spring = stiffness * (phi - memory[0])
    if spring > parameter[0]:
        return parameter[0], 0.0, 0.0
    if spring < -parameter[0]:
        return -parameter[0], 0.0, 0.0
    return spring, stiffness, 0.0


def advance(phi: float, rate: float, elapsed: float, k0: float, k2: float, memory: Any, parameter: Any) -> None:
    memory[0] = min(max(memory[0], phi - PRESLIDING_RAD), phi + PRESLIDING_RAD)


def apply(setup: Setup, values: Values) -> Setup:
    return with_law(setup, LawUse(HINGE, torque, (values["torque_Nm"],), advance))


EFFECT = Effect(
    id="hinge_coulomb_friction",
    where="hinges",
    left_out="dry friction of the pins",
    law="T = T_c sgn(phi'), stuck below T_c",
    source="Coulomb; the paper's eqs. (18)-(19) applied to a hinge",
    parameters=(Parameter("torque_Nm", 0.002, 0.5),),
    apply=apply,
)
