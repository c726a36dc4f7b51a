"""A soft floor under the contact."""

from dataclasses import replace

from rfca_rig.model.effect import Effect, Parameter, Values
from rfca_rig.model.setup import Setup


def apply(setup: Setup, values: Values) -> Setup:
    """Two Hertz springs in series: depths add, so k^(-2/3) adds."""
    rig, ground = setup.rig, setup.rig.ground
    hard, added = (k ** (-2.0 / 3.0) for k in (ground.stiffness_N_per_m1p5, values["stiffness_N_per_m1p5"]))
    return replace(setup, rig=replace(rig, ground=replace(ground, stiffness_N_per_m1p5=(hard + added) ** -1.5)))


EFFECT = Effect(
    id="ground_compliance",
    where="ground",
    left_out="soft floor",
    law="N = k depth^1.5 in series with the believed contact",
    source="Hertz contacts in series",
    parameters=(Parameter("stiffness_N_per_m1p5", 5000.0, 1000000.0, may_be_zero=False),),
    apply=apply,
    same_as="contact_stiffness",
)
