"""A sensor whose reading of fz does not pass a limit."""

from dataclasses import replace

import numpy as np

from rfca_rig.model.effect import Effect, Parameter, Values
from rfca_rig.model.setup import Felt, Setup, with_sensor


def apply(setup: Setup, values: Values) -> Setup:
    """It acts on what the effects of the sensor that are stated before it have made of fz."""
    limit_N = values["limit_N"]

    def clip(felt: Felt) -> Felt:
        return replace(felt, fz_N=np.clip(felt.fz_N, -limit_N, limit_N))

    return with_sensor(setup, clip)


EFFECT = Effect(
    id="sensor_saturation",
    where="sensor",
    left_out="fz is cut off at a limit",
    law="fz between -limit and limit",
    source="range of an amplifier or of its converter",
    # below the force of the valley it matters where it is, above it does nothing: begin at several
    parameters=(Parameter("limit_N", 5.0, 100.0, may_be_zero=False, starts=tuple(8.0 * 1.15**n for n in range(16))),),
    apply=apply,
)
