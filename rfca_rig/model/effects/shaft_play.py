"""Play between motor and leg: a loose screw, a worn key."""

import numpy as np

from rfca_rig.model.effect import Effect, Parameter, Values
from rfca_rig.model.setup import CompliantDrive, Setup, with_drive

STIFFNESS_NM_PER_RAD = 2000.0  # beyond the play: a steel shaft of 10 mm, which twists by 1 mrad under 2 N m
LOSS_S_PER_RAD = 0.3  # steel on steel: a factor of five up or down changes fz by 0.1 to 0.5 N rms of 26 N


def apply(setup: Setup, values: Values) -> Setup:
    """At rest the weight holds the play closed; without play the shaft is that of the plain model."""
    gap_rad = float(np.radians(values["half_gap_deg"]))
    if gap_rad == 0.0:
        return setup
    return with_drive(setup, CompliantDrive("shaft_play", STIFFNESS_NM_PER_RAD, 0.0, 0.0, gap_rad=gap_rad, loss_s_per_rad=LOSS_S_PER_RAD))


EFFECT = Effect(
    id="shaft_play",
    where="drive",
    left_out="play between motor and leg",
    law="tau = k b (1 + a b'), b = sgn(d) max(|d| - gap, 0), d = theta_motor - theta_leg, k = 2000 N m/rad, a = 0.3 s/rad, never pulling",
    source="dead zone whose ends are contacts of Hunt and Crossley (1975)",
    parameters=(Parameter("half_gap_deg", 0.1, 5.0),),
    apply=apply,
)
