"""A viscoelastic arm in parallel to the hinge spring: a spring in series with a dashpot (Maxwell).

It models the creep in strokes and in static stages, where the relaxation continues from stage to stage.
"""

from typing import Any

import numpy as np
from numba import njit

from rfca_rig.model.effect import Effect, Parameter, Values
from rfca_rig.model.laws import HINGE, LawUse
from rfca_rig.model.setup import Setup, with_law


def slack(phi: float, elapsed: float, memory: Any, tau: float) -> tuple[float, float]:
    """Dashpot angle x and dx/dphi after `elapsed` [s], exact for a phi that moves linearly; memory = (x, phi) at the last step."""
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
    # Creep with log time, 4 % per decade from 10 ms to 100 s: one arm beside k0 leaves 3 % of its effect in strokes, 7 % in static stages
    # held for 1 s, and 5 % in both, with time constants of 0.3 to 2 s. An arm slower than 1 s acts as a stiffer, less hardening spring in
    # a stroke: another k0 and k2 leave 8 % of it; in static stages they leave 49 % at 1 s, 20 % at 10 s, 8 % at 30 s.
    parameters=(
        Parameter("strength_relative", 0.02, 1.0),
        Parameter("time_constant_s", 0.01, 10.0, may_be_zero=False),
    ),
    apply=apply,
)
