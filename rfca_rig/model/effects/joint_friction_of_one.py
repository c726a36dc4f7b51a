"""Dry friction of one joint of a pendulum, with stick, for example where only one of two has a gear."""

from rfca_rig.errors import BadInput
from rfca_rig.model.effect import Effect, Parameter, Values
from rfca_rig.model.effects.joint_friction import friction_of
from rfca_rig.model.setup import Setup, with_law


def apply(setup: Setup, values: Values) -> Setup:
    """Raises BadInput for a joint that the rig does not have."""
    joints, joint = len(setup.rig.leg.link_lengths_m) - 1, values["joint"]
    if not (float(joint).is_integer() and 1 <= joint <= joints):
        raise BadInput(f"effect joint_friction_of_one: joint {joint:g}: there are joints 1 to {joints}")
    return with_law(setup, friction_of(values["torque_Nm"], int(joint)))


EFFECT = Effect(
    id="joint_friction_of_one",
    where="pendulum-like rigs",
    left_out="dry friction of one joint",
    law="T = T_c sgn(phi') in one joint, stuck below T_c",
    source="Coulomb; presliding as in joint_friction",
    parameters=(Parameter("joint", 1.0, 2.0, whole=True), Parameter("torque_Nm", 0.005, 1.0)),
    apply=apply,
    variant_of="joint_stribeck",
)
