"""Torsional compliance between motor and leg."""

from rfca_rig.model.effect import Effect, Parameter, Values
from rfca_rig.model.setup import CompliantDrive, Setup, with_drive


def apply(setup: Setup, values: Values) -> Setup:
    stiffness = values["stiffness_Nm_per_rad"]
    return with_drive(setup, CompliantDrive("shaft_compliance", stiffness, 1e-3 * values["relaxation_ms"] * stiffness, 0.0))


EFFECT = Effect(
    id="shaft_compliance",
    where="drive",
    left_out="twist between motor and leg",
    law="tau = k (theta_motor - theta_leg) + k t_r (w_motor - w_leg)",
    source="torsion spring in series with the shaft",
    parameters=(Parameter("stiffness_Nm_per_rad", 5.0, 2000.0, may_be_zero=False),),
    apply=apply,
    # Internal damping over stiffness: at the neutral value the oscillation of the twist decays within milliseconds.
    # At 100 N m/rad, fz over a stroke (215 mm, 2.433 rad/s) changes by 0.03 N rms at 0.1 ms and 0.18 N at 10 ms
    shape=(Parameter("relaxation_ms", 0.1, 10.0, may_be_zero=False, neutral=1.0),),
)
