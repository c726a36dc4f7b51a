"""More viscous damping in every hinge than in the nominal model."""

from dataclasses import replace

from rfca_rig.model.effect import Effect, Parameter, Values
from rfca_rig.model.setup import Setup


def apply(setup: Setup, values: Values) -> Setup:
    leg = setup.rig.leg
    damping = leg.hinge_damping_Nm_s_per_rad + values["coefficient_Nm_s_per_rad"]
    return replace(setup, rig=replace(setup.rig, leg=replace(leg, hinge_damping_Nm_s_per_rad=damping)))


EFFECT = Effect(
    id="hinge_viscous_damping",
    where="hinges",
    left_out="more damping than believed",
    law="T = c phi', on top of the nominal damping",
    source="Kelvin-Voigt element",
    parameters=(Parameter("coefficient_Nm_s_per_rad", 0.005, 0.5),),
    apply=apply,
    same_as="hinge_damping",
)
