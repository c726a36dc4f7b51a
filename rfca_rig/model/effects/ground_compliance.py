"""A soft floor under the contact."""

from dataclasses import replace

from rfca_rig.model.effect import Effect, Parameter, Values
from rfca_rig.model.setup import Setup


def apply(setup: Setup, values: Values) -> Setup:
    """Two Hertz springs in series: depths add, so k^(-2/3) adds.

    Friction acts somewhere between the circle's lowest point and where the circle enters the floor. Where a lever tells how far from the
    lowest point that is in the believed floor, it is as much farther in one that the circle goes deeper into.
    """
    rig, ground = setup.rig, setup.rig.ground
    hard, added = (k ** (-2.0 / 3.0) for k in (ground.stiffness_N_per_m1p5, values["stiffness_N_per_m1p5"]))
    radius, deeper = rig.leg.link_radius_m, (hard + added) / hard
    lever = None if ground.friction_lever_m is None else radius + deeper * (ground.friction_lever_m - radius)
    soft = replace(ground, stiffness_N_per_m1p5=(hard + added) ** -1.5, friction_lever_m=lever)
    return replace(setup, rig=replace(rig, ground=soft))


EFFECT = Effect(
    id="ground_compliance",
    where="ground",
    left_out="soft floor",
    law="N = k depth^1.5 in series with the believed contact",
    source="Hertz contacts in series",
    parameters=(Parameter("stiffness_N_per_m1p5", 5000.0, 1000000.0, may_be_zero=False),),
    apply=apply,
)
