"""A twist between motor and leg."""

from rfca_rig.model.effect import Effect, Parameter, Values
from rfca_rig.model.setup import Setup, SoftDrive, with_drive

RELAXATION_S = 1e-3  # internal damping of the twist: its ringing dies within milliseconds


def apply(setup: Setup, values: Values) -> Setup:
    stiffness = values["stiffness_Nm_per_rad"]
    return with_drive(setup, SoftDrive(stiffness, RELAXATION_S * stiffness, 0.0))


EFFECT = Effect(
    id="shaft_compliance",
    where="drive",
    left_out="twist between motor and leg",
    law="tau = k (theta_motor - theta_leg)",
    source="torsion spring in series with the shaft",
    parameters=(Parameter("stiffness_Nm_per_rad", 5.0, 2000.0, may_be_zero=False),),
    apply=apply,
)
