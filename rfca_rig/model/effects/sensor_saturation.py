"""Saturation of fz: the reading does not exceed a limit."""

from dataclasses import replace

import numpy as np

from rfca_rig.model.effect import Effect, Parameter, Values
from rfca_rig.model.setup import SensorOutput, Setup, with_sensor


def apply(setup: Setup, values: Values) -> Setup:
    """It acts on fz after all effects of the sensor that are stated before it."""
    limit_N = values["limit_N"]

    def clip(felt: SensorOutput) -> SensorOutput:
        return replace(felt, fz_N=np.clip(felt.fz_N, -limit_N, limit_N))

    return with_sensor(setup, clip)


EFFECT = Effect(
    id="sensor_saturation",
    where="sensor",
    left_out="fz is cut off at a limit",
    law="fz between -limit and limit",
    source="range of an amplifier or of its converter",
    # A limit above the force of the valley does nothing and gives no direction to a fit, so there are several starts.
    parameters=(Parameter("limit_N", 5.0, 100.0, may_be_zero=False, starts=tuple(8.0 * 1.15**n for n in range(16))),),
    apply=apply,
)
