"""A motor whose torque is limited: its speed falls behind under load and catches up afterwards."""

from rfca_rig.model.effect import Effect, Parameter, Values
from rfca_rig.model.effects.motor_speed_droop import ROTOR_KG_M2
from rfca_rig.model.setup import CompliantDrive, Setup, with_drive


def apply(setup: Setup, values: Values) -> Setup:
    drive = CompliantDrive(
        "motor_torque_limit",
        values["ki_Nm_per_rad"],
        values["kp_Nm_s_per_rad"],
        ROTOR_KG_M2,
        setup.rig.drive.holds_start,
        limit_Nm=values["limit_Nm"],
    )
    return with_drive(setup, drive)


EFFECT = Effect(
    id="motor_torque_limit",
    where="drive",
    left_out="the motor's torque is limited",
    law="|tau| <= limit, tau = kp (w_c - w) + ki (theta_c - theta) within it",
    source="current limit of a servo drive; its integrator goes on, as without anti-windup",
    parameters=(Parameter("limit_Nm", 0.5, 20.0, may_be_zero=False, starts=tuple(0.7 * 1.3**n for n in range(12))),),
    apply=apply,
    # Within the limit: a drive that sags by 0.2 to 2 mrad under 1 N m. A softer one is `motor_speed_droop`, with or without a limit
    shape=(
        Parameter("kp_Nm_s_per_rad", 20.0, 200.0, may_be_zero=False, neutral=50.0),
        Parameter("ki_Nm_per_rad", 500.0, 5000.0, may_be_zero=False, neutral=1000.0),
    ),
)
