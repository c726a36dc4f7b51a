"""Dry friction of the hinge pins, with stick."""

import numpy as np

from rfca_rig.model.dry_friction import dry_friction
from rfca_rig.model.effect import Effect, EqualLimit, Parameter, Values
from rfca_rig.model.setup import Setup, with_law

DAMPING_S = 2e-3  # about critical for the paper's links on a stuck pin
# Stiffness of a loop of strength 1 beside the paper's springs. A stuck pin that is stiffer is outside of the loop's plausible range.
STIFFEST_LOOP_NM_PER_RAD = 11.0


def apply(setup: Setup, values: Values) -> Setup:
    # 0 to 2 are all torques that a stuck pin can have, from full resistance in one direction to the other.
    let_go = min(max(values["let_go"], 0.0), 2.0)
    return with_law(setup, dry_friction(values["torque_Nm"], float(np.radians(values["presliding_deg"])), DAMPING_S, let_go=let_go))


def yields_as_a_loop(values: Values) -> bool:
    """Whether a stuck pin is no stiffer than the stiffest loop."""
    return bool(values["torque_Nm"] <= STIFFEST_LOOP_NM_PER_RAD * np.radians(values["presliding_deg"]))


EFFECT = Effect(
    id="hinge_coulomb_friction",
    where="hinges",
    left_out="dry friction of the pins",
    law="T = T_c sgn(phi'), stuck below T_c",
    source="Coulomb; the paper's eqs. (18)-(19) applied to a hinge, its stuck state damped",
    parameters=(Parameter("torque_Nm", 0.002, 0.5),),
    apply=apply,
    # Rotation before a stuck pin slips; the neutral value, 1 mrad, is far below the resolution of a photo.
    # At 0.05 N m, fz over a stroke (215 mm, 2.433 rad/s) changes by 0.08 N rms at 0.02 degrees and 0.67 N at 1.5 degrees.
    shape=(Parameter("presliding_deg", 0.02, 1.5, may_be_zero=False, starts=(0.06, 0.4), neutral=float(np.degrees(1e-3))),),
    # A leg that swung before comes to rest with pins that resist its weight less, or add to it.
    begins=(Parameter("let_go", -2.0, 2.0),),
    # fy, fz and tx of two strokes up to lift-off, 0.05 and 0.2 N m, 0.06 to 1.5 degrees: the fitted loop leaves 3 to 8 % of the effect.
    equal_limits=(
        EqualLimit(
            "spring_hysteresis",
            "presliding above T_c / k0: a loop that saturates there, of exponent 2 to 3",
            yields_as_a_loop,
        ),
    ),
)
