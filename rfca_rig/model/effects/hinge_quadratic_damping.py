"""Damping in every hinge that grows with the square of the speed."""

from typing import Any

from rfca_rig.model.effect import Effect, Parameter, Values
from rfca_rig.model.laws import HINGE, LawUse
from rfca_rig.model.setup import Setup, with_law


def torque(phi: float, rate: float, elapsed: float, k0: float, k2: float, memory: Any, parameter: Any) -> tuple[float, float, float]:
    return parameter[0] * rate * abs(rate), 0.0, 2.0 * parameter[0] * abs(rate)


def apply(setup: Setup, values: Values) -> Setup:
    return with_law(setup, LawUse(HINGE, torque, (values["coefficient_Nm_s2_per_rad2"],)))


EFFECT = Effect(
    id="hinge_quadratic_damping",
    where="hinges",
    left_out="damping that grows with the square of the speed",
    law="T = c phi' |phi'|, on top of the nominal damping",
    source="turbulent loss of a fluid that the hinge displaces: Bernoulli's pressure drop, proportional to the square of the flow",
    parameters=(Parameter("coefficient_Nm_s2_per_rad2", 0.001, 0.3),),
    apply=apply,
)
