"""Adhesion of the floor, which holds the leg back at lift-off."""

from typing import Any

import numpy as np

from rfca_rig.model.effect import Effect, Parameter, Values
from rfca_rig.model.laws import NORMAL, LawUse
from rfca_rig.model.setup import Setup, with_law


def force(depth: float, rate: float, memory: Any, parameter: Any) -> tuple[float, float, float]:
    # The force builds up over a reach: a constant force would jump where the tip touches.
    left = np.exp(-depth / parameter[1])
    return -parameter[0] * (1.0 - left), -parameter[0] * left / parameter[1], 0.0


def apply(setup: Setup, values: Values) -> Setup:
    return with_law(setup, LawUse(NORMAL, force, (values["force_N"], 1e-3 * values["reach_mm"])))


EFFECT = Effect(
    id="ground_adhesion",
    where="ground",
    left_out="floor holds the leg back at lift-off",
    law="N - F (1 - exp(-depth / reach)) while touching",
    source="Derjaguin, Muller and Toporov 1975 (constant); Johnson, Kendall and Roberts 1971 (grows with the contact)",
    parameters=(Parameter("force_N", 0.1, 20.0),),
    apply=apply,
    # Depth over which adhesion builds up. The force depends on depth alone, so it creates no energy for any shape.
    # At 2 N, fy over a stroke (215 mm, 2.433 rad/s) changes by 0.001 N rms at 0.01 mm and 0.03 N at 1 mm
    shape=(Parameter("reach_mm", 0.01, 1.0, may_be_zero=False, neutral=0.05),),
)
