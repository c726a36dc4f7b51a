"""Hinges that have taken a set: without load the leg is bent."""

import numpy as np

from rfca_rig.model.effect import Effect, Parameter, Values
from rfca_rig.model.setup import Setup, with_chain
from rfca_rig.model.state import Chain


def shift_rest(setup: Setup, angle_deg: float, hinges: slice) -> Setup:
    """Adds to the rest angle of these hinges, counted as the chain's links."""

    def shift(chain: Chain) -> Chain:
        rest = chain.rest.copy()
        rest[hinges] += np.radians(angle_deg)
        return chain._replace(rest=rest)

    return with_chain(setup, shift)


def apply(setup: Setup, values: Values) -> Setup:
    return shift_rest(setup, values["angle_deg"], slice(1, None))


EFFECT = Effect(
    id="hinge_rest_angle",
    where="hinges",
    left_out="the hinges rest at an angle: a permanent set",
    law="phi counts from this angle in the spring's torque, in all hinges",
    source="eq. (12), phi_i0",
    parameters=(Parameter("angle_deg", -6.0, 6.0),),
    apply=apply,
)
