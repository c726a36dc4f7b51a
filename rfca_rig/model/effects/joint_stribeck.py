"""Dry friction of every joint that falls with speed, with stick."""

from typing import Any

import numpy as np

from rfca_rig.model.effect import Effect, Parameter, Values
from rfca_rig.model.effects.joint_friction import DAMPING_S, PRESLIDING_RAD
from rfca_rig.model.laws import HINGE, LawUse
from rfca_rig.model.setup import Setup, with_law


def torque(phi: float, rate: float, elapsed: float, k0: float, k2: float, memory: Any, parameter: Any) -> tuple[float, float, float]:
    # parameter = (torque at high speed, rise, speed scale, presliding, damping time); memory[0] is the anchor of the stuck state.
    rise = parameter[1] * np.exp(-abs(rate) / parameter[2])
    most = parameter[0] * (1.0 + rise)
    stiffness = parameter[0] / parameter[3]
    stuck = stiffness * (phi - memory[0] + parameter[4] * rate)
    if abs(stuck) > most:
        return np.sign(stuck) * most, 0.0, -np.sign(stuck) * np.sign(rate) * parameter[0] * rise / parameter[2]
    return stuck, stiffness, stiffness * parameter[4]


def advance(phi: float, rate: float, elapsed: float, k0: float, k2: float, memory: Any, parameter: Any) -> None:
    # The stretch at which the spring carries the whole friction at this speed.
    reach = parameter[3] * (1.0 + parameter[1] * np.exp(-abs(rate) / parameter[2]))
    memory[0] = min(max(memory[0], phi - reach), phi + reach)


def apply(setup: Setup, values: Values) -> Setup:
    parameters = (values["torque_Nm"], values["rise_relative"], values["speed_rad_s"], PRESLIDING_RAD, DAMPING_S)
    return with_law(setup, LawUse(HINGE, torque, parameters, advance))


EFFECT = Effect(
    id="joint_stribeck",
    where="pendulum-like rigs",
    left_out="dry friction of the joints that falls with speed",
    law="T = T_c (1 + rise exp(-|phi'| / w_s)) sgn(phi'), stuck below T_c (1 + rise)",
    source="Stribeck 1902, exponential form; presliding as in joint_friction",
    parameters=(
        Parameter("torque_Nm", 0.005, 1.0),
        Parameter("rise_relative", 0.25, 2.5),
        Parameter("speed_rad_s", 0.1, 5.0, may_be_zero=False),
    ),
    apply=apply,
)
