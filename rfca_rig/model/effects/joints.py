"""Effects in the joints of a pendulum: dry friction, Stribeck friction and inertia."""

from typing import Any

import numpy as np

from rfca_rig.errors import BadInput
from rfca_rig.model.effect import Effect, Parameter, Values
from rfca_rig.model.effects.hinge_friction import dry_friction
from rfca_rig.model.kernel.laws import HINGE, ROTOR, LawUse
from rfca_rig.model.setup import Setup, with_law

# Dry friction of every joint, with stick.

PRESLIDING_RAD = 5e-4  # rotation before a stuck joint slips: about one count of a joint's encoder
DAMPING_S = 5e-3  # a stuck joint is at rest after some hundredths of a second


def friction_of(
    torque_Nm: float, joint: int = -1, presliding_rad: float = PRESLIDING_RAD
) -> LawUse:
    """The law on one joint, from 1, or on all."""
    return dry_friction(torque_Nm, presliding_rad, DAMPING_S, joint)


def apply_joint_friction(setup: Setup, values: Values) -> Setup:
    return with_law(
        setup,
        friction_of(
            values["torque_Nm"], presliding_rad=float(np.radians(values["presliding_deg"]))
        ),
    )


JOINT_FRICTION = Effect(
    id="joint_friction",
    where="pendulum-like rigs",
    left_out="dry friction of the joints and their gears",
    law="T = T_c sgn(phi'), stuck below T_c",
    source="Coulomb; presliding as of Dahl, damped as in LuGre (Canudas de Wit et al. 1995)",
    parameters=(Parameter("torque_Nm", 0.005, 1.0),),
    apply=apply_joint_friction,
    variant_of="joint_stribeck",  # with a rise of zero
    # Neutral: about one count of a joint's encoder. At 0.05 N m, fz over a stroke of the leg (215
    # mm, 2.433 rad/s) changes by 0.03 N rms at 0.01 degrees and 0.67 N at 1.5 degrees.
    shape=(
        Parameter(
            "presliding_deg",
            0.01,
            1.5,
            may_be_zero=False,
            neutral=float(np.degrees(PRESLIDING_RAD)),
        ),
    ),
)


# Dry friction of one joint of a pendulum, with stick, for example where only one of two has a gear.


def apply_joint_friction_of_one(setup: Setup, values: Values) -> Setup:
    """Raises BadInput for a joint that the rig does not have."""
    joints = len(setup.rig.leg.link_lengths_m) - 1
    joint = values["joint"]
    if not (float(joint).is_integer() and 1 <= joint <= joints):
        raise BadInput(
            f"effect joint_friction_of_one: joint {joint:g}: there are joints 1 to {joints}"
        )
    return with_law(setup, friction_of(values["torque_Nm"], int(joint)))


JOINT_FRICTION_OF_ONE = Effect(
    id="joint_friction_of_one",
    where="pendulum-like rigs",
    left_out="dry friction of one joint",
    law="T = T_c sgn(phi') in one joint, stuck below T_c",
    source="Coulomb; presliding as in joint_friction",
    parameters=(Parameter("joint", 1.0, 2.0, whole=True), Parameter("torque_Nm", 0.005, 1.0)),
    apply=apply_joint_friction_of_one,
    variant_of="joint_stribeck",
)


# Dry friction of every joint that falls with speed, with stick.


def joint_stribeck_torque(
    phi: float, rate: float, elapsed: float, k0: float, k2: float, memory: Any, parameter: Any
) -> tuple[float, float, float]:
    # parameter = (torque at high speed, rise, speed scale, presliding, damping time); memory[0] is
    # the anchor of the stuck state.
    rise = parameter[1] * np.exp(-abs(rate) / parameter[2])
    most = parameter[0] * (1.0 + rise)
    stiffness = parameter[0] / parameter[3]
    stuck = stiffness * (phi - memory[0] + parameter[4] * rate)
    if abs(stuck) > most:
        return (
            np.sign(stuck) * most,
            0.0,
            -np.sign(stuck) * np.sign(rate) * parameter[0] * rise / parameter[2],
        )
    return stuck, stiffness, stiffness * parameter[4]


def joint_stribeck_advance(
    phi: float, rate: float, elapsed: float, k0: float, k2: float, memory: Any, parameter: Any
) -> None:
    # The stretch at which the spring carries the whole friction at this speed.
    reach = parameter[3] * (1.0 + parameter[1] * np.exp(-abs(rate) / parameter[2]))
    memory[0] = min(max(memory[0], phi - reach), phi + reach)


def apply_joint_stribeck(setup: Setup, values: Values) -> Setup:
    parameters = (
        values["torque_Nm"],
        values["rise_relative"],
        values["speed_rad_s"],
        PRESLIDING_RAD,
        DAMPING_S,
    )
    return with_law(setup, LawUse(HINGE, joint_stribeck_torque, parameters, joint_stribeck_advance))


JOINT_STRIBECK = Effect(
    id="joint_stribeck",
    where="pendulum-like rigs",
    left_out="dry friction of the joints that falls with speed",
    law="T = T_c (1 + rise exp(-|phi'| / w_s)) sgn(phi'), stuck below T_c (1 + rise)",
    source="Stribeck 1902, exponential form; presliding as in joint_friction",
    parameters=(
        Parameter("torque_Nm", 0.005, 1.0),
        Parameter("rise_relative", 0.25, 2.5),
        Parameter("speed_rad_s", 0.1, 5.0, may_be_zero=False),
    ),
    apply=apply_joint_stribeck,
)


# Reflected inertia of every joint: that of a rotor behind a gear, times the gear ratio squared.


def joint_inertia_torque(
    phi: float,
    rate: float,
    acceleration: float,
    elapsed: float,
    k0: float,
    k2: float,
    memory: Any,
    parameter: Any,
) -> tuple[float, float, float, float]:
    return parameter[0] * acceleration, 0.0, 0.0, parameter[0]


def inertia_of(inertia_kg_m2: float, joint: int = -1) -> LawUse:
    """The law on one joint, from 1, or on all."""
    return LawUse(ROTOR, joint_inertia_torque, (inertia_kg_m2,), None, joint)


def apply_joint_inertia(setup: Setup, values: Values) -> Setup:
    return with_law(setup, inertia_of(values["inertia_kg_m2"]))


JOINT_INERTIA = Effect(
    id="joint_inertia",
    where="pendulum-like rigs",
    left_out="inertia of the motors' rotors behind their gears",
    law="T = I phi''",
    source=(
        "reflected inertia, I = gear ratio^2 rotor inertia; the rotor's spin with the link "
        "before it is left out"
    ),
    parameters=(Parameter("inertia_kg_m2", 1e-4, 0.3),),
    apply=apply_joint_inertia,
)


EFFECTS = (
    JOINT_FRICTION,
    JOINT_FRICTION_OF_ONE,
    JOINT_STRIBECK,
    JOINT_INERTIA,
)
