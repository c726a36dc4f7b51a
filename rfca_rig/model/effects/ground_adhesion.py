"""A floor that holds the leg back at lift-off."""

from typing import Any

import numpy as np

from rfca_rig.model.effect import Effect, Parameter, Values
from rfca_rig.model.laws import NORMAL, LawUse
from rfca_rig.model.setup import Setup, with_law

REACH_M = 5e-5  # depth over which adhesion takes hold, so that the force does not jump


def force(depth: float, rate: float, memory: Any, parameter: Any) -> tuple[float, float, float]:
    left = np.exp(-depth / REACH_M)
    return -parameter[0] * (1.0 - left), -parameter[0] * left / REACH_M, 0.0


def apply(setup: Setup, values: Values) -> Setup:
    return with_law(setup, LawUse(NORMAL, force, (values["force_N"],)))


EFFECT = Effect(
    id="ground_adhesion",
    where="ground",
    left_out="floor holds the leg back at lift-off",
    law="N - F while touching",
    source="constant pull-off force",
    parameters=(Parameter("force_N", 0.1, 20.0),),
    apply=apply,
)
