"""One hinge that has taken a set."""

from rfca_rig.model.effect import Effect, Parameter, Values
from rfca_rig.model.effects.hinge_rest_angle import shift_rest
from rfca_rig.model.setup import Setup, link_of_hinge


def apply(setup: Setup, values: Values) -> Setup:
    link = link_of_hinge(setup, "hinge_rest_angle_of_one", values["hinge"])
    return shift_rest(setup, values["angle_deg"], slice(link, link + 1))


EFFECT = Effect(
    id="hinge_rest_angle_of_one",
    where="one hinge",
    left_out="one hinge rests at an angle: a permanent set",
    law="phi counts from this angle in the spring's torque, in one hinge",
    source="eq. (12), phi_i0",
    parameters=(Parameter("hinge", 2.0, 7.0, whole=True), Parameter("angle_deg", -6.0, 6.0)),
    apply=apply,
    variant_of="hinge_rest_angle",
)
