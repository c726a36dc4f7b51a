"""Friction at the shaft from outside the leg, for example of a dragging cable or a worn bearing."""

from rfca_rig.model.effect import Effect, Parameter, Values
from rfca_rig.model.setup import Setup, with_chain
from rfca_rig.model.state import Chain


def apply(setup: Setup, values: Values) -> Setup:
    """It is visible in tx, and slows a compliant drive."""

    def drag(chain: Chain) -> Chain:
        return chain._replace(shaft_friction=chain.shaft_friction + values["torque_Nm"])

    return with_chain(setup, drag)


EFFECT = Effect(
    id="shaft_friction",
    where="shaft",
    left_out="friction at the shaft, as of a cable that drags",
    law="T = T_c sgn(w) against the turn of the shaft, full from 0.02 rad/s on",
    source="Coulomb",
    parameters=(Parameter("torque_Nm", 0.005, 1.0),),
    apply=apply,
)
