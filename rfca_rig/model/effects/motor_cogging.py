"""Cogging torque of a motor; its speed loop compensates it, the better the slower the motor turns."""

import numpy as np

from rfca_rig.model.effect import Effect, Parameter, Values
from rfca_rig.model.effects.motor_speed_droop import ROTOR_KG_M2
from rfca_rig.model.setup import CompliantDrive, Setup, with_drive


def apply(setup: Setup, values: Values) -> Setup:
    """A motor that does not cog is the plain one."""
    if values["torque_Nm"] == 0.0:
        return setup
    drive = CompliantDrive(
        "motor_cogging",
        values["ki_Nm_per_rad"],
        values["kp_Nm_s_per_rad"],
        ROTOR_KG_M2,
        setup.rig.drive.holds_start,
        cogging_Nm=values["torque_Nm"],
        cogging_cycles=values["cycles_per_turn"],
        cogging_phase_rad=float(2.0 * np.pi * values["phase_cycles"]),
    )
    return with_drive(setup, drive)


EFFECT = Effect(
    id="motor_cogging",
    where="drive",
    left_out="the motor cogs",
    law="tau = T sin(n (theta - theta_0) + phase) beside kp (w_c - w) + ki (theta_c - theta)",
    source="cogging torque of permanent-magnet motors: teeth and magnets, n is their least common multiple",
    parameters=(
        Parameter("torque_Nm", 0.02, 3.0, starts=(0.5,)),
        # A stroke is half a turn: it distinguishes numbers of cycles that differ by two.
        Parameter("cycles_per_turn", 4.0, 90.0, may_be_zero=False, starts=tuple(1.5 * n for n in range(3, 60))),
    ),
    apply=apply,
    # A drive that sags by 0.2 to 10 mrad under 1 N m; a softer one is `motor_speed_droop`.
    # Periodic in the phase, so a fit may go beyond half a cycle in either direction.
    shape=(
        Parameter("phase_cycles", -0.5, 0.5, starts=(-0.25, 0.0, 0.25, 0.5)),
        Parameter("kp_Nm_s_per_rad", 5.0, 200.0, may_be_zero=False, neutral=15.0),
        Parameter("ki_Nm_per_rad", 100.0, 5000.0, may_be_zero=False, neutral=300.0),
    ),
)
