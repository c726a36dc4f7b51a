"""Another hardening k2 of the hinges' torque curve than the nominal one."""

from dataclasses import replace

from rfca_rig.model.effect import Effect, Parameter, Values
from rfca_rig.model.setup import Setup


def apply(setup: Setup, values: Values) -> Setup:
    return replace(setup, rig=replace(setup.rig, leg=replace(setup.rig.leg, k2_per_rad2=values["k2_per_rad2"])))


EFFECT = Effect(
    id="stiffness_hardening",
    where="hinges",
    left_out="torque curve harder or softer than believed at large angles",
    law="T = k0 phi (1 + k2 phi^2) with this k2 in place of the nominal one",
    source="cubic hardening",
    parameters=(Parameter("k2_per_rad2", 0.0, 15.0),),
    apply=apply,
    needs_k2=True,
)
