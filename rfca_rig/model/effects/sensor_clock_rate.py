"""A force clock that runs at another rate than the shaft's."""

from dataclasses import replace

import numpy as np

from rfca_rig.model.effect import Effect, Parameter, Values
from rfca_rig.model.setup import SensorOutput, Setup, with_sensor


def apply(setup: Setup, values: Values) -> Setup:
    """With a positive rate the force appears too late after the beginning of the motion, in proportion to time, and too early before it."""

    def stretch(felt: SensorOutput) -> SensorOutput:
        then = felt.t_s * (1.0 - values["rate_relative"])
        fy, fz, tx = (np.interp(then, felt.t_s, channel) for channel in (felt.fy_N, felt.fz_N, felt.tx_Nm))
        return replace(felt, fy_N=fy, fz_N=fz, tx_Nm=tx)

    return with_sensor(setup, stretch)


EFFECT = Effect(
    id="sensor_clock_rate",
    where="sensor",
    left_out="the force clock runs fast or slow",
    law="force(t) = true force(t - rate t), t from the beginning of the motion",
    source="-",
    # A shift longer than a spike of the force changes the residual no longer in proportion to the rate, so small rates are starts, too.
    parameters=(Parameter("rate_relative", -0.03, 0.03, below=0.5, starts=(-0.012, -0.004, -0.0015, 0.0015, 0.004, 0.012)),),
    apply=apply,
)
