"""Shell segments that meet: stiff beyond an angle, either way."""

from typing import Any

import numpy as np

from rfca_rig.model.effect import Effect, Parameter, Values
from rfca_rig.model.laws import HINGE, LawUse
from rfca_rig.model.setup import Setup, with_law

# Forces determine the angle of a stop to a quarter of a degree: a start that is off by half a degree shows no improvement.
ANGLES_DEG = (6.0, 8.0, 10.0, 12.0, *(14.0 + 0.4 * n for n in range(51)), 36.0)


# Rotation into the stop at which its torque does not depend on the exponent, about 3 degrees.
REFERENCE_RAD = 0.05
# Share of the reference: keeps the slope finite at the stop's beginning for exponents below one.
ROUNDED = 0.01


def torque(phi: float, rate: float, elapsed: float, k0: float, k2: float, memory: Any, parameter: Any) -> tuple[float, float, float]:
    beyond = abs(phi) - parameter[0]
    if beyond <= 0.0:
        return 0.0, 0.0, 0.0
    # Without the rounding, so that the neutral exponent is exactly a linear spring.
    if parameter[2] == 1.0:
        return np.sign(phi) * parameter[1] * beyond, parameter[1], 0.0
    u, n = beyond / REFERENCE_RAD + ROUNDED, parameter[2]
    return np.sign(phi) * parameter[1] * REFERENCE_RAD * (u**n - ROUNDED**n), parameter[1] * n * u ** (n - 1.0), 0.0


def apply(setup: Setup, values: Values) -> Setup:
    return with_law(setup, LawUse(HINGE, torque, (np.radians(values["angle_deg"]), values["stiffness_Nm_per_rad"], values["exponent"])))


EFFECT = Effect(
    id="hinge_stop",
    where="hinges",
    left_out="shell segments meet, stiff beyond an angle",
    law="T = k b (beyond / b)^n sgn(phi), beyond = |phi| - angle, b = 0.05 rad, n = 1 unless given",
    source="one-sided spring",
    parameters=(
        Parameter("angle_deg", 5.0, 45.0, starts=ANGLES_DEG),
        Parameter("stiffness_Nm_per_rad", 10.0, 1000.0, starts=(13.0, 40.0)),
    ),
    apply=apply,
    # At 18 degrees and 40 N m/rad, fz over a stroke (215 mm, 2.433 rad/s) changes by 0.39 N rms with an exponent of 0.8, 1.64 N with 2.5.
    shape=(Parameter("exponent", 0.8, 2.5, may_be_zero=False, neutral=1.0),),
)
