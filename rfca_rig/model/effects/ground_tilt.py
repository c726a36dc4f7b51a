"""A floor that is not level."""

import numpy as np

from rfca_rig.model.effect import Effect, Parameter, Values
from rfca_rig.model.setup import Setup, with_chain
from rfca_rig.model.state import Chain


def apply(setup: Setup, values: Values) -> Setup:
    """A positive slope rises towards +y, where the leg starts."""
    angle = np.arctan(values["slope"])

    def tilt(chain: Chain) -> Chain:
        return chain._replace(floor_cos=float(np.cos(angle)), floor_sin=-float(np.sin(angle)))

    return with_chain(setup, tilt)


EFFECT = Effect(
    id="ground_tilt",
    where="ground",
    left_out="floor not level",
    law="floor at -height + slope y",
    source="-",
    parameters=(Parameter("slope", -0.1, 0.1),),
    apply=apply,
)
