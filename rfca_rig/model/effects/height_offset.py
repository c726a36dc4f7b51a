"""A rack that is higher or lower than stated."""

from dataclasses import replace

from rfca_rig.model.effect import Effect, Parameter, Values
from rfca_rig.model.setup import Setup


def apply(setup: Setup, values: Values) -> Setup:
    return replace(setup, height_m=setup.height_m + 1e-3 * values["offset_mm"])


EFFECT = Effect(
    id="height_offset",
    where="rig",
    left_out="rack height wrong",
    law="true height = stated height + offset",
    source="-",
    parameters=(Parameter("offset_mm", -10.0, 10.0),),
    apply=apply,
    same_as="height",
)
