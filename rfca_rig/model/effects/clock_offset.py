"""A constant offset between the clocks of force sensor and shaft."""

from dataclasses import replace

import numpy as np

from rfca_rig.model.effect import Effect, Parameter, Values
from rfca_rig.model.setup import SensorOutput, Setup, with_sensor


def apply(setup: Setup, values: Values) -> Setup:
    """A positive offset makes the force appear later than it was."""

    # Beyond the first and the last sample `np.interp` repeats the end values.
    def shift(felt: SensorOutput) -> SensorOutput:
        then = felt.t_s - values["offset_s"]
        fy, fz, tx = (np.interp(then, felt.t_s, channel) for channel in (felt.fy_N, felt.fz_N, felt.tx_Nm))
        return replace(felt, fy_N=fy, fz_N=fz, tx_Nm=tx)

    return with_sensor(setup, shift)


EFFECT = Effect(
    id="clock_offset",
    where="sensor",
    left_out="force and shaft clocks apart",
    law="force(t) = true force(t - offset)",
    source="-",
    parameters=(Parameter("offset_s", -0.05, 0.05),),
    apply=apply,
)
