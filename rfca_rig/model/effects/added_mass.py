"""A mass at the end of a pendulum-like chain."""

from rfca_rig.model.effect import Effect, Parameter, Values
from rfca_rig.model.effects.tip_mass import add_tip_mass
from rfca_rig.model.setup import Setup


def apply(setup: Setup, values: Values) -> Setup:
    return add_tip_mass(setup, values["mass_kg"])


EFFECT = Effect(
    id="added_mass",
    where="pendulum-like rigs",
    left_out="a mass at the end of the last link",
    law="point mass at the distal end of the last link",
    source="-",
    parameters=(Parameter("mass_kg", 0.01, 2.0),),
    apply=apply,
)
