"""One hinge that has taken a set."""

from rfca_rig.errors import BadInput
from rfca_rig.model.effect import Effect, Parameter, Values
from rfca_rig.model.effects.hinge_rest_angle import shift_rest
from rfca_rig.model.setup import Setup


def apply(setup: Setup, values: Values) -> Setup:
    """Raises BadInput for a hinge that the leg does not have."""
    hinge, last = values["hinge"], len(setup.rig.leg.link_lengths_m)
    if not 1.5 <= hinge < last + 0.5:
        raise BadInput(f"effect hinge_rest_angle_of_one: hinge {hinge:g} is not there; this leg has hinges 2 to {last}")
    link = round(hinge) - 1  # hinge i is the proximal one of link i, links counted from one
    return shift_rest(setup, values["angle_deg"], slice(link, link + 1))


EFFECT = Effect(
    id="hinge_rest_angle_of_one",
    where="one hinge",
    left_out="one hinge rests at an angle: a permanent set",
    law="phi counts from this angle in k0 phi + k0 k2 phi^3, in one hinge",
    source="eq. (12), phi_i0",
    parameters=(Parameter("hinge", 2.0, 7.0, whole=True), Parameter("angle_deg", -6.0, 6.0)),
    apply=apply,
    variant_of="hinge_rest_angle",
)
