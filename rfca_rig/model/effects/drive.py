"""Effects between the commanded and the true motion of the shaft: of motor, coupling and
bearing.
"""

from dataclasses import replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from rfca_rig.model.declarations import drive as declared
from rfca_rig.model.effect import Parameter, Values
from rfca_rig.model.kernel.state import Chain
from rfca_rig.model.motion import ShaftMotion
from rfca_rig.model.setup import CompliantDrive, Setup, with_chain, with_drive

Floats = NDArray[np.float64]


# A drive whose speed sags under load and surges after it: a PI speed loop on a rotor.

ROTOR_KG_M2 = 0.006  # motor and gear at the shaft; the sag itself hardly depends on it


def apply_motor_speed_droop(setup: Setup, values: Values) -> Setup:
    drive = CompliantDrive(
        declared.MOTOR_SPEED_DROOP.id,
        values["ki_Nm_per_rad"],
        values["kp_Nm_s_per_rad"],
        ROTOR_KG_M2,
        setup.rig.drive.holds_start,
    )
    return with_drive(setup, drive)


MOTOR_SPEED_DROOP = declared.MOTOR_SPEED_DROOP.make_effect(
    parameters=(
        Parameter("kp_Nm_s_per_rad", 0.5, 200.0),
        Parameter("ki_Nm_per_rad", 1.0, 5000.0, may_be_zero=False),
    ),
    apply=apply_motor_speed_droop,
)


# A motor whose torque is limited: its speed falls behind under load and catches up afterwards.


def apply_motor_torque_limit(setup: Setup, values: Values) -> Setup:
    drive = CompliantDrive(
        declared.MOTOR_TORQUE_LIMIT.id,
        values["ki_Nm_per_rad"],
        values["kp_Nm_s_per_rad"],
        ROTOR_KG_M2,
        setup.rig.drive.holds_start,
        limit_Nm=values["limit_Nm"],
    )
    return with_drive(setup, drive)


MOTOR_TORQUE_LIMIT = declared.MOTOR_TORQUE_LIMIT.make_effect(
    parameters=(
        Parameter(
            "limit_Nm", 0.5, 20.0, may_be_zero=False, starts=tuple(0.7 * 1.3**n for n in range(12))
        ),
    ),
    apply=apply_motor_torque_limit,
    # Within the limit: a drive that sags by 0.2 to 2 mrad under 1 N m. A softer one is
    # `motor_speed_droop`, with or without a limit
    shape=(
        Parameter("kp_Nm_s_per_rad", 20.0, 200.0, may_be_zero=False, neutral=50.0),
        Parameter("ki_Nm_per_rad", 500.0, 5000.0, may_be_zero=False, neutral=1000.0),
    ),
)


# Cogging torque of a motor; its speed loop compensates it, the better the slower the motor turns.


def apply_motor_cogging(setup: Setup, values: Values) -> Setup:
    """A motor that does not cog is the plain one."""
    if values["torque_Nm"] == 0.0:
        return setup
    drive = CompliantDrive(
        declared.MOTOR_COGGING.id,
        values["ki_Nm_per_rad"],
        values["kp_Nm_s_per_rad"],
        ROTOR_KG_M2,
        setup.rig.drive.holds_start,
        cogging_Nm=values["torque_Nm"],
        cogging_cycles=values["cycles_per_turn"],
        cogging_phase_rad=float(2.0 * np.pi * values["phase_cycles"]),
    )
    return with_drive(setup, drive)


MOTOR_COGGING = declared.MOTOR_COGGING.make_effect(
    parameters=(
        Parameter("torque_Nm", 0.02, 3.0, starts=(0.5,)),
        # A stroke is half a turn: it distinguishes numbers of cycles that differ by two.
        Parameter(
            "cycles_per_turn",
            4.0,
            90.0,
            may_be_zero=False,
            starts=tuple(1.5 * n for n in range(3, 60)),
        ),
    ),
    apply=apply_motor_cogging,
    # A drive that sags by 0.2 to 10 mrad under 1 N m; a softer one is `motor_speed_droop`.
    # Periodic in the phase, so a fit may go beyond half a cycle in either direction.
    shape=(
        Parameter("phase_cycles", -0.5, 0.5, starts=(-0.25, 0.0, 0.25, 0.5)),
        Parameter("kp_Nm_s_per_rad", 5.0, 200.0, may_be_zero=False, neutral=15.0),
        Parameter("ki_Nm_per_rad", 100.0, 5000.0, may_be_zero=False, neutral=300.0),
    ),
)


# A shaft speed that varies with the shaft angle.

# Spacing of the pieces of the motion: at 60 cycles per turn and 3.3 rad/s a cycle takes 32 ms.
RIPPLE_STEP_S = 5e-4


def apply_motor_speed_ripple(setup: Setup, values: Values) -> Setup:
    phase_rad = 2.0 * np.pi * values["phase_cycles"]
    return replace(
        setup,
        motion=add_ripple(
            setup.motion, values["amplitude_relative"], values["cycles_per_turn"], phase_rad
        ),
    )


def add_ripple(
    motion: ShaftMotion, amplitude: float, cycles: float, phase_rad: float = 0.0
) -> ShaftMotion:
    """The motion that follows from the law, in closed form.

    With psi = n (theta - theta_0) + phase, d psi / d theta_c = n (1 + a cos psi). So the angle is a
    function of the commanded one alone: tan(psi / 2) = r tan x, x = sqrt(1 - a^2) n (theta_c -
    theta_0) / 2 + x_0.
    """
    t = _times(motion)
    start = motion.start_rad
    r = np.sqrt((1.0 + amplitude) / (1.0 - amplitude))
    x = np.sqrt(1.0 - amplitude * amplitude) * cycles * (
        motion.angle_rad(t) - start
    ) / 2.0 + _scale_tangent(0.5 * phase_rad, 1.0 / r)
    half = _scale_tangent(x, r)
    angle = start + (2.0 * half - phase_rad) / cycles
    speed = _speed(motion, t) * (1.0 + amplitude * np.cos(2.0 * half))
    # Cubic Hermite pieces through angles and speeds.
    step = np.diff(t)
    rise = np.diff(angle) / step
    square = (3.0 * rise - 2.0 * speed[:-1] - speed[1:]) / step
    cube = (speed[:-1] + speed[1:] - 2.0 * rise) / step**2
    return ShaftMotion(
        t, np.column_stack([angle[:-1], speed[:-1], square, cube]), motion.landings_s
    )


def _scale_tangent(x: Floats | float, r: float) -> Floats:
    """The angle whose tangent is r tan x, on the branch of x."""
    # As a difference to x, which is always within a quarter turn, the arctangent needs no count of
    # branches.
    sin = np.sin(x)
    cos = np.cos(x)
    return np.asarray(x + np.arctan((r - 1.0) * sin * cos / (cos**2 + r * sin**2)))


def _times(motion: ShaftMotion) -> Floats:
    """Times from zero to the end, with every break of the motion among them."""
    breaks = np.unique(np.maximum(motion.breaks_s, 0.0))
    pieces = (
        np.linspace(t0, t1, int(np.ceil((t1 - t0) / RIPPLE_STEP_S)) + 1)[:-1]
        for t0, t1 in pairwise(breaks)
    )
    return np.concatenate([*pieces, breaks[-1:]])


def _speed(motion: ShaftMotion, t: Floats) -> Floats:
    i = np.clip(np.searchsorted(motion.breaks_s, t) - 1, 0, len(motion.coefficients) - 1)
    x = t - motion.breaks_s[i]
    c = motion.coefficients[i].T
    return np.asarray(c[1] + x * (2.0 * c[2] + x * 3.0 * c[3]))


MOTOR_SPEED_RIPPLE = declared.MOTOR_SPEED_RIPPLE.make_effect(
    parameters=(
        Parameter("amplitude_relative", 0.005, 0.3, below=1.0, starts=(0.05,)),
        # A stroke is half a turn: it distinguishes numbers of cycles that differ by two.
        Parameter(
            "cycles_per_turn",
            1.0,
            60.0,
            may_be_zero=False,
            starts=tuple(1.5 * n for n in range(1, 40)),
        ),
    ),
    apply=apply_motor_speed_ripple,
    # Periodic, so a fit may go beyond half a cycle in either direction; four starts make one of
    # them near. At 5 % and 10 cycles, fz over a stroke (215 mm, 2.433 rad/s) changes by 0.54 N rms
    # at -0.25, 1.34 N at 0.25, 1.84 N at 0.5
    shape=(Parameter("phase_cycles", -0.5, 0.5, starts=(-0.25, 0.0, 0.25, 0.5)),),
)


# Torsional compliance between motor and leg.


def apply_shaft_compliance(setup: Setup, values: Values) -> Setup:
    stiffness = values["stiffness_Nm_per_rad"]
    return with_drive(
        setup,
        CompliantDrive(
            declared.SHAFT_COMPLIANCE.id, stiffness, 1e-3 * values["relaxation_ms"] * stiffness, 0.0
        ),
    )


SHAFT_COMPLIANCE = declared.SHAFT_COMPLIANCE.make_effect(
    parameters=(Parameter("stiffness_Nm_per_rad", 5.0, 2000.0, may_be_zero=False),),
    apply=apply_shaft_compliance,
    # Internal damping over stiffness: at the neutral value the oscillation of the twist decays
    # within milliseconds. At 100 N m/rad, fz over a stroke (215 mm, 2.433 rad/s) changes by 0.03 N
    # rms at 0.1 ms and 0.18 N at 10 ms
    shape=(Parameter("relaxation_ms", 0.1, 10.0, may_be_zero=False, neutral=1.0),),
)


# Play between motor and leg: a loose screw, a worn key.

# beyond the play: a steel shaft of 10 mm, which twists by 1 mrad under 2 N m
PLAY_STIFFNESS_NM_PER_RAD = 2000.0
# steel on steel: a factor of five up or down changes fz by 0.1 to 0.5 N rms of 26 N
PLAY_LOSS_S_PER_RAD = 0.3


def apply_shaft_play(setup: Setup, values: Values) -> Setup:
    """At rest the weight holds the play closed; without play the shaft is that of the plain
    model.
    """
    gap_rad = float(np.radians(values["half_gap_deg"]))
    if gap_rad == 0.0:
        return setup
    return with_drive(
        setup,
        CompliantDrive(
            declared.SHAFT_PLAY.id,
            PLAY_STIFFNESS_NM_PER_RAD,
            0.0,
            0.0,
            gap_rad=gap_rad,
            loss_s_per_rad=PLAY_LOSS_S_PER_RAD,
        ),
    )


SHAFT_PLAY = declared.SHAFT_PLAY.make_effect(
    parameters=(Parameter("half_gap_deg", 0.1, 5.0),),
    apply=apply_shaft_play,
)


# Friction at the shaft from outside the leg, for example of a dragging cable or a worn bearing.


def apply_shaft_friction(setup: Setup, values: Values) -> Setup:
    """It is visible in tx, and slows a compliant drive."""

    def drag(chain: Chain) -> Chain:
        return chain._replace(shaft_friction=chain.shaft_friction + values["torque_Nm"])

    return with_chain(setup, drag)


SHAFT_FRICTION = declared.SHAFT_FRICTION.make_effect(
    parameters=(Parameter("torque_Nm", 0.005, 1.0),),
    apply=apply_shaft_friction,
)


EFFECTS = (
    MOTOR_SPEED_DROOP,
    MOTOR_TORQUE_LIMIT,
    MOTOR_COGGING,
    MOTOR_SPEED_RIPPLE,
    SHAFT_COMPLIANCE,
    SHAFT_PLAY,
    SHAFT_FRICTION,
)
