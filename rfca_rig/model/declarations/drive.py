"""Effects between the commanded and the true motion of the shaft: of motor, coupling and
bearing.
"""

from rfca_rig.model.effect import LEG_SIDE, MOTOR_SIDE, Declaration

MOTOR_SPEED_DROOP = Declaration(
    id="motor_speed_droop",
    where="drive",
    left_out="speed sags under load and surges after it",
    law="J dw/dt = tau - load, tau = kp (w_c - w) + ki (theta_c - theta), J = 0.006 kg m2",
    source="PI speed control of a rotor",
    families=("drive_yields",),
    encoder=MOTOR_SIDE,
    in_motion_only=True,
)

MOTOR_TORQUE_LIMIT = Declaration(
    id="motor_torque_limit",
    where="drive",
    left_out="the motor's torque is limited",
    law=(
        "J dw/dt = tau - load, |tau| <= limit, tau = kp (w_c - w) + ki (theta_c - theta) within "
        "it, J = 0.006 kg m2"
    ),
    source="current limit of a servo drive; its integrator goes on, as without anti-windup",
    families=("drive_yields",),
    encoder=MOTOR_SIDE,
    in_motion_only=True,
)

MOTOR_COGGING = Declaration(
    id="motor_cogging",
    where="drive",
    left_out="the motor cogs",
    law=(
        "J dw/dt = tau + T sin(n (theta - theta_0) + phase) - load, tau = kp (w_c - w) + ki "
        "(theta_c - theta), theta_0 = theta_c before the motion, J = 0.006 kg m2"
    ),
    source=(
        "cogging torque of permanent-magnet motors: teeth and magnets, n is their least "
        "common multiple"
    ),
    families=("drive_ripple",),
    encoder=MOTOR_SIDE,
    in_motion_only=True,
)

MOTOR_SPEED_RIPPLE = Declaration(
    id="motor_speed_ripple",
    where="drive",
    left_out="shaft speed that varies with shaft angle",
    law="w = w_c (1 + a cos(n (theta - theta_0) + phase))",
    source="torque ripple of gear and motor",
    families=("drive_ripple",),
    encoder=MOTOR_SIDE,
    in_motion_only=True,
)

SHAFT_COMPLIANCE = Declaration(
    id="shaft_compliance",
    where="drive",
    left_out="twist between motor and leg",
    law="tau = k (theta_motor - theta_leg) + k t_r (w_motor - w_leg)",
    source="torsion spring in series with the shaft",
    families=("drive_yields",),
    encoder=LEG_SIDE,
)

SHAFT_PLAY = Declaration(
    id="shaft_play",
    where="drive",
    left_out="play between motor and leg",
    law=(
        "tau = k b (1 + a b'), b = sgn(d) max(|d| - gap, 0), d = theta_motor - theta_leg, k "
        "= 2000 N m/rad, a = 0.3 s/rad, never pulling"
    ),
    source="dead zone whose ends are contacts of Hunt and Crossley (1975)",
    families=("drive_yields",),
    encoder=LEG_SIDE,
)

SHAFT_FRICTION = Declaration(
    id="shaft_friction",
    where="shaft",
    left_out="friction at the shaft, as of a cable that drags",
    law="T = T_c sgn(w) against the turn of the shaft, full from 0.02 rad/s on",
    source="Coulomb",
    families=("shaft_friction",),
    in_motion_only=True,
)
