"""Quadratic drag of the surrounding fluid, normal to the links."""

from typing import Any

from rfca_rig.model.effect import Effect, Parameter, Values
from rfca_rig.model.laws import LINK, LawUse
from rfca_rig.model.setup import Setup, with_law


def force(v: float, length: float, memory: Any, parameter: Any) -> tuple[float, float]:
    return -parameter[0] * length * v * abs(v), -2.0 * parameter[0] * length * abs(v)


def apply(setup: Setup, values: Values) -> Setup:
    return with_law(setup, LawUse(LINK, force, (values["coefficient_N_s2_per_m3"],)))


EFFECT = Effect(
    id="fluid_drag",
    where="surroundings",
    left_out="drag normal to the links",
    law="F = - c length v |v| at the middle of each link",
    source="quadratic drag of a flat strip, c = rho C_D width / 2",
    parameters=(Parameter("coefficient_N_s2_per_m3", 0.05, 50.0),),
    apply=apply,
)
