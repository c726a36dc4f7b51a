"""Play in the hinges: the spring engages only beyond half the gap."""

from typing import Any

import numpy as np

from rfca_rig.model.effect import Effect, Parameter, Values
from rfca_rig.model.laws import HINGE, LawUse
from rfca_rig.model.setup import Setup, with_law


def torque(phi: float, rate: float, elapsed: float, k0: float, k2: float, memory: Any, parameter: Any) -> tuple[float, float, float]:
    # The chain has added the nominal spring already: the law is the spring with play less the spring without.
    bent = max(abs(phi) - parameter[0], 0.0)
    engaged = np.sign(phi) * k0 * bent * (1.0 + k2 * bent * bent)
    slope = k0 * (1.0 + 3.0 * k2 * bent * bent) if bent > 0.0 else 0.0
    return engaged - k0 * phi * (1.0 + k2 * phi * phi), slope - k0 * (1.0 + 3.0 * k2 * phi * phi), 0.0


def apply(setup: Setup, values: Values) -> Setup:
    return with_law(setup, LawUse(HINGE, torque, (np.radians(values["half_gap_deg"]),)))


EFFECT = Effect(
    id="hinge_backlash",
    where="hinges",
    left_out="play before the spring engages",
    law="T = spring(sgn(phi) max(|phi| - gap, 0))",
    source="dead zone in series with the spring",
    parameters=(Parameter("half_gap_deg", 0.05, 4.0),),
    apply=apply,
    needs_k2=True,
)
