"""A point mass at the end of the last link."""

import numpy as np

from rfca_rig.model.effect import Effect, Parameter, Values
from rfca_rig.model.setup import Setup, with_chain
from rfca_rig.model.state import Chain


def add_tip_mass(setup: Setup, mass_kg: float) -> Setup:
    """The setup with the mass on the tip: it acts at the far end of every link."""

    def load(chain: Chain) -> Chain:
        return chain._replace(
            moment=chain.moment + mass_kg * np.outer(chain.length, chain.length),
            first_moment=chain.first_moment + mass_kg * chain.length,
            total_mass=chain.total_mass + mass_kg,
        )

    return with_chain(setup, load)


def apply(setup: Setup, values: Values) -> Setup:
    return add_tip_mass(setup, 1e-3 * values["mass_g"])


EFFECT = Effect(
    id="tip_mass",
    where="tip",
    left_out="mass at the tip",
    law="point mass at the distal end of the last link",
    source="-",
    parameters=(Parameter("mass_g", 0.5, 100.0),),
    apply=apply,
)
