"""A rig that is not plumb: gravity has a part along the floor."""

import numpy as np

from rfca_rig.model.effect import Effect, Parameter, Values
from rfca_rig.model.setup import Setup, with_chain
from rfca_rig.model.state import Chain


def apply(setup: Setup, values: Values) -> Setup:
    """A positive angle lets gravity pull towards +y, where the leg starts."""

    def lean(chain: Chain) -> Chain:
        g = chain.gravity
        return chain._replace(gravity=g * float(np.cos(values["angle_rad"])), gravity_along=g * float(np.sin(values["angle_rad"])))

    return with_chain(setup, lean)


EFFECT = Effect(
    id="gravity_tilt",
    where="rig",
    left_out="rig not plumb",
    law="gravity = g (sin, cos) of the angle, along y and down",
    source="-",
    parameters=(Parameter("angle_rad", -0.1, 0.1),),
    apply=apply,
)
