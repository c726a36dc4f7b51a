"""A rate-independent loop beside the spring (Bouc-Wen with unit exponent)."""

from typing import Any

import numpy as np

from rfca_rig.model.effect import Effect, Parameter, Values
from rfca_rig.model.laws import HINGE, LawUse
from rfca_rig.model.setup import Setup, with_law


def torque(phi: float, rate: float, elapsed: float, k0: float, k2: float, memory: Any, parameter: Any) -> tuple[float, float, float]:
    """memory = (z, phi) at the last step; z' = (1 - z sgn phi') phi' / saturation has an exact solution along one direction."""
    side = 1.0 if phi >= memory[1] else -1.0
    z = side + (memory[0] - side) * np.exp(-abs(phi - memory[1]) / parameter[1])
    full = parameter[0] * k0 * parameter[1]
    return full * z, full * (1.0 - side * z) / parameter[1], 0.0


def advance(phi: float, rate: float, elapsed: float, k0: float, k2: float, memory: Any, parameter: Any) -> None:
    side = 1.0 if phi >= memory[1] else -1.0
    memory[0] = side + (memory[0] - side) * np.exp(-abs(phi - memory[1]) / parameter[1])
    memory[1] = phi


def apply(setup: Setup, values: Values) -> Setup:
    return with_law(setup, LawUse(HINGE, torque, (values["strength_relative"], np.radians(values["saturation_deg"])), advance))


EFFECT = Effect(
    id="spring_hysteresis",
    where="hinges",
    left_out="rate-independent loop of the spring (Bouc-Wen)",
    law="T = s k0 phi_s z, z' = (1 - z sgn(phi')) phi' / phi_s",
    source="Bouc 1967, Wen 1976, exponent one",
    parameters=(
        Parameter("strength_relative", 0.02, 1.0),
        Parameter("saturation_deg", 0.5, 20.0, may_be_zero=False),
    ),
    apply=apply,
)
