"""A viscoelastic arm beside the spring: a spring in series with a dashpot (Maxwell)."""

from typing import Any

import numpy as np
from numba import njit

from rfca_rig.model.effect import Effect, Parameter, Values
from rfca_rig.model.laws import HINGE, LawUse
from rfca_rig.model.setup import Setup, with_law


def slack(phi: float, elapsed: float, memory: Any, tau: float) -> tuple[float, float]:
    """Dashpot angle x and dx/dphi after `elapsed`, phi moving straight from where it was; memory = (x, phi) then."""
    if elapsed <= 0.0:
        return memory[0], 0.0
    left, share = np.exp(-elapsed / tau), tau / elapsed
    gained = phi - memory[1]
    return phi - gained * share * (1.0 - left) + (memory[0] - memory[1]) * left, 1.0 - share * (1.0 - left)


slack = njit(slack, error_model="numpy")


def torque(phi: float, rate: float, elapsed: float, k0: float, k2: float, memory: Any, parameter: Any) -> tuple[float, float, float]:
    x, x_phi = slack(phi, elapsed, memory, parameter[1])
    return parameter[0] * k0 * (phi - x), parameter[0] * k0 * (1.0 - x_phi), 0.0


def advance(phi: float, rate: float, elapsed: float, k0: float, k2: float, memory: Any, parameter: Any) -> None:
    memory[0] = slack(phi, elapsed, memory, parameter[1])[0]
    memory[1] = phi


def apply(setup: Setup, values: Values) -> Setup:
    return with_law(setup, LawUse(HINGE, torque, (values["strength_relative"], values["time_constant_s"]), advance))


EFFECT = Effect(
    id="spring_relaxation",
    where="hinges",
    left_out="viscoelastic arm beside the spring (Maxwell)",
    law="T = s k0 (phi - x), x' = (phi - x) / tau",
    source="Maxwell element",
    parameters=(
        Parameter("strength_relative", 0.02, 1.0),
        Parameter("time_constant_s", 0.01, 5.0, may_be_zero=False),
    ),
    apply=apply,
)
