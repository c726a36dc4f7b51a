"""A drive whose speed sags under load and surges after it: a PI speed loop on a rotor."""

from rfca_rig.model.effect import Effect, Parameter, Values
from rfca_rig.model.setup import CompliantDrive, Setup, with_drive

ROTOR_KG_M2 = 0.006  # motor and gear at the shaft; the sag itself hardly depends on it


def apply(setup: Setup, values: Values) -> Setup:
    drive = CompliantDrive(
        "motor_speed_droop", values["ki_Nm_per_rad"], values["kp_Nm_s_per_rad"], ROTOR_KG_M2, setup.rig.drive.holds_start
    )
    return with_drive(setup, drive)


EFFECT = Effect(
    id="motor_speed_droop",
    where="drive",
    left_out="speed sags under load and surges after it",
    law="tau = kp (w_c - w) + ki (theta_c - theta)",
    source="PI speed control of a rotor",
    parameters=(
        Parameter("kp_Nm_s_per_rad", 0.5, 200.0),
        Parameter("ki_Nm_per_rad", 1.0, 5000.0, may_be_zero=False),
    ),
    apply=apply,
)
