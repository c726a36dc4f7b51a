"""Dry friction of every joint, with stick."""

import numpy as np

from rfca_rig.model.dry_friction import dry_friction
from rfca_rig.model.effect import Effect, Parameter, Values
from rfca_rig.model.laws import LawUse
from rfca_rig.model.setup import Setup, with_law

PRESLIDING_RAD = 5e-4  # rotation before a stuck joint slips: about one count of a joint's encoder
DAMPING_S = 5e-3  # a stuck joint is at rest after some hundredths of a second


def friction_of(torque_Nm: float, joint: int = -1, presliding_rad: float = PRESLIDING_RAD) -> LawUse:
    """The law on one joint, from 1, or on all."""
    return dry_friction(torque_Nm, presliding_rad, DAMPING_S, joint)


def apply(setup: Setup, values: Values) -> Setup:
    return with_law(setup, friction_of(values["torque_Nm"], presliding_rad=float(np.radians(values["presliding_deg"]))))


EFFECT = Effect(
    id="joint_friction",
    where="pendulum-like rigs",
    left_out="dry friction of the joints and their gears",
    law="T = T_c sgn(phi'), stuck below T_c",
    source="Coulomb; presliding as of Dahl, damped as in LuGre (Canudas de Wit et al. 1995)",
    parameters=(Parameter("torque_Nm", 0.005, 1.0),),
    apply=apply,
    variant_of="joint_stribeck",  # with a rise of zero
    # Neutral: about one count of a joint's encoder. At 0.05 N m, fz over a stroke of the leg (215 mm, 2.433 rad/s) changes by 0.03 N rms
    # at 0.01 degrees and 0.67 N at 1.5 degrees.
    shape=(Parameter("presliding_deg", 0.01, 1.5, may_be_zero=False, neutral=float(np.degrees(PRESLIDING_RAD))),),
)
