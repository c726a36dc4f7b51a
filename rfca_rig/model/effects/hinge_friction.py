"""Effects that dissipate energy in the hinges: dry friction with stick, viscous and quadratic
damping.
"""

from dataclasses import replace
from typing import Any

import numpy as np

from rfca_rig.model.declarations import hinges as declared
from rfca_rig.model.effect import EqualLimit, Parameter, Values
from rfca_rig.model.kernel.laws import HINGE, LawUse
from rfca_rig.model.setup import Setup, with_law

# Dry friction with stick, as a law of hinges and joints.
#
# A stuck pin yields like a stiff spring with a damper, so that it comes to rest instead of ringing:
# real contacts lose energy in their micro-slip long before they slide. The sum of both never
# exceeds the friction torque; beyond it, the spring's anchor moves with the pin. Presliding as of
# Dahl, damped as in LuGre (Canudas de Wit et al. 1995). The friction of a stuck pin at rest depends
# on its path; it is a parameter of the law.

# A longer time since the last step means that `chain` is seeking a rest pose.
AT_REST_S = 1e6


def dry_friction_torque(
    phi: float, rate: float, elapsed: float, k0: float, k2: float, memory: Any, parameter: Any
) -> tuple[float, float, float]:
    # parameter = (friction torque, presliding, damping time, let_go); memory[0] is the anchor's
    # angle.
    stiffness = parameter[0] / parameter[1]
    stuck = stiffness * (phi - memory[0] + parameter[2] * rate)
    share = 1.0 - parameter[3] if elapsed > AT_REST_S else 1.0
    if stuck > parameter[0]:
        return share * parameter[0], 0.0, 0.0
    if stuck < -parameter[0]:
        return -share * parameter[0], 0.0, 0.0
    return share * stuck, share * stiffness, share * stiffness * parameter[2]


def dry_friction_advance(
    phi: float, rate: float, elapsed: float, k0: float, k2: float, memory: Any, parameter: Any
) -> None:
    # At rest the anchor is put where the spring gives the torque with which the pose was found.
    if elapsed > AT_REST_S:
        bent = min(max(phi - memory[0], -parameter[1]), parameter[1])
        memory[0] = phi - (1.0 - parameter[3]) * bent
    memory[0] = min(max(memory[0], phi - parameter[1]), phi + parameter[1])


def dry_friction(
    torque_Nm: float, presliding_rad: float, damping_s: float, only: int = -1, let_go: float = 0.0
) -> LawUse:
    """The law on one hinge or joint, or on all: it slips after `presliding_rad`; the damping is
    `damping_s` times the stiffness.

    `let_go` is how much less of the bending a pin resists at rest: 0 resists it in full, 1 has no
    torque, 2 acts the other way.
    """
    return LawUse(
        HINGE,
        dry_friction_torque,
        (torque_Nm, presliding_rad, damping_s, let_go),
        dry_friction_advance,
        only,
    )


# Dry friction of the hinge pins, with stick.

DAMPING_S = 2e-3  # about critical for the paper's links on a stuck pin
# Stiffness of a loop of strength 1 beside the paper's springs. A stuck pin that is stiffer is
# outside of the loop's plausible range.
STIFFEST_LOOP_NM_PER_RAD = 11.0


def apply_hinge_coulomb_friction(setup: Setup, values: Values) -> Setup:
    # 0 to 2 are all torques that a stuck pin can have, from full resistance in one direction to the
    # other.
    let_go = min(max(values["let_go"], 0.0), 2.0)
    return with_law(
        setup,
        dry_friction(
            values["torque_Nm"],
            float(np.radians(values["presliding_deg"])),
            DAMPING_S,
            let_go=let_go,
        ),
    )


def yields_as_a_loop(values: Values) -> bool:
    """Whether a stuck pin is no stiffer than the stiffest loop."""
    return bool(
        values["torque_Nm"] <= STIFFEST_LOOP_NM_PER_RAD * np.radians(values["presliding_deg"])
    )


HINGE_COULOMB_FRICTION = declared.HINGE_COULOMB_FRICTION.make_effect(
    parameters=(Parameter("torque_Nm", 0.002, 0.5),),
    apply=apply_hinge_coulomb_friction,
    # Rotation before a stuck pin slips; the neutral value, 1 mrad, is far below the resolution of a
    # photo. At 0.05 N m, fz over a stroke (215 mm, 2.433 rad/s) changes by 0.08 N rms at 0.02
    # degrees and 0.67 N at 1.5 degrees.
    shape=(
        Parameter(
            "presliding_deg",
            0.02,
            1.5,
            may_be_zero=False,
            starts=(0.06, 0.4),
            neutral=float(np.degrees(1e-3)),
        ),
    ),
    # A leg that swung before comes to rest with pins that resist its weight less, or add to it.
    begins=(Parameter("let_go", -2.0, 2.0),),
    # fy, fz and tx of two strokes up to lift-off, 0.05 and 0.2 N m, 0.06 to 1.5 degrees: the fitted
    # loop leaves 3 to 8 % of the effect.
    equal_limits=(
        EqualLimit(
            declared.SPRING_HYSTERESIS.id,
            "presliding above T_c / k0: a loop that saturates there, of exponent 2 to 3",
            yields_as_a_loop,
        ),
    ),
)


# More viscous damping in every hinge than in the nominal model.


def apply_hinge_viscous_damping(setup: Setup, values: Values) -> Setup:
    leg = setup.rig.leg
    damping = leg.hinge_damping_Nm_s_per_rad + values["coefficient_Nm_s_per_rad"]
    return replace(
        setup, rig=replace(setup.rig, leg=replace(leg, hinge_damping_Nm_s_per_rad=damping))
    )


HINGE_VISCOUS_DAMPING = declared.HINGE_VISCOUS_DAMPING.make_effect(
    parameters=(Parameter("coefficient_Nm_s_per_rad", 0.005, 0.5),),
    apply=apply_hinge_viscous_damping,
)


# Damping in every hinge that grows with the square of the speed.


def hinge_quadratic_damping_torque(
    phi: float, rate: float, elapsed: float, k0: float, k2: float, memory: Any, parameter: Any
) -> tuple[float, float, float]:
    return parameter[0] * rate * abs(rate), 0.0, 2.0 * parameter[0] * abs(rate)


def apply_hinge_quadratic_damping(setup: Setup, values: Values) -> Setup:
    return with_law(
        setup,
        LawUse(HINGE, hinge_quadratic_damping_torque, (values["coefficient_Nm_s2_per_rad2"],)),
    )


HINGE_QUADRATIC_DAMPING = declared.HINGE_QUADRATIC_DAMPING.make_effect(
    parameters=(Parameter("coefficient_Nm_s2_per_rad2", 0.001, 0.3),),
    apply=apply_hinge_quadratic_damping,
)


EFFECTS = (
    HINGE_COULOMB_FRICTION,
    HINGE_VISCOUS_DAMPING,
    HINGE_QUADRATIC_DAMPING,
)
