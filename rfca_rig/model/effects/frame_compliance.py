"""A frame that yields vertically under the leg."""

import numpy as np

from rfca_rig.model.effect import Effect, Parameter, Values
from rfca_rig.model.setup import Setup, with_chain
from rfca_rig.model.state import Chain


def apply(setup: Setup, values: Values) -> Setup:
    mass, rate = values["moving_mass_kg"], 2.0 * np.pi * values["frequency_Hz"]

    def yielding(chain: Chain) -> Chain:
        return chain._replace(
            frame_mass=mass, frame_stiffness=mass * rate * rate, frame_damping=2.0 * values["damping_ratio"] * mass * rate
        )

    return with_chain(setup, yielding)


EFFECT = Effect(
    id="frame_compliance",
    where="rig",
    left_out="frame and sensor yield vertically",
    law="m z'' + 2 d m w z' + m w^2 z = - fz",
    source="one vertical degree of freedom",
    parameters=(
        Parameter("frequency_Hz", 5.0, 100.0, may_be_zero=False),
        Parameter("moving_mass_kg", 0.5, 50.0, may_be_zero=False),
        Parameter("damping_ratio", 0.005, 0.5),
    ),
    apply=apply,
)
