"""First-order lag of all channels of the sensor."""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from rfca_rig.model.compiled import jit
from rfca_rig.model.effect import Effect, EqualLimit, Parameter, Values
from rfca_rig.model.setup import SensorOutput, Setup, with_sensor

Floats = NDArray[np.float64]


def apply(setup: Setup, values: Values) -> Setup:
    tau = values["time_constant_s"]

    def lag(felt: SensorOutput) -> SensorOutput:
        t = felt.t_s
        return replace(
            felt,
            fy_N=filter_first_order(t, felt.fy_N, tau),
            fz_N=filter_first_order(t, felt.fz_N, tau),
            tx_Nm=filter_first_order(t, felt.tx_Nm, tau),
        )

    return with_sensor(setup, lag)


def filter_first_order(t_s: Floats, x: Floats, tau_s: float) -> Floats:
    """Output (m,) of y' = (x - y) / tau from rest for the input `x` (m,) at times `t_s` (m,); exact for x linear between samples."""
    # Two samples may have the same time; there nothing decays and nothing is added.
    step = np.diff(t_s) / tau_s
    left = np.exp(-step)
    ramp = (1.0 - left) / np.where(step > 0.0, step, 1.0)
    y = x.copy()
    fill_first_order(left, (ramp - left) * x[:-1] + (1.0 - ramp) * x[1:], y)
    return y


@jit
def fill_first_order(left: Floats, gained: Floats, y: Floats) -> None:
    """y (m,) from its first value on: of each value `left` (m - 1,) remains, `gained` (m - 1,) is added."""
    for i in range(gained.size):
        y[i + 1] = left[i] * y[i] + gained[i]


def only_delays(values: Values) -> bool:
    """Whether the lag is so short that the forces do not change their shape."""
    return values["time_constant_s"] <= 4e-3


EFFECT = Effect(
    id="sensor_lag",
    where="sensor",
    left_out="first-order lag of all channels",
    law="tau y' = x - y",
    source="first-order low-pass",
    parameters=(Parameter("time_constant_s", 0.0005, 0.05, may_be_zero=False),),
    apply=apply,
    # fy, fz and tx of two strokes up to lift-off: a fitted offset leaves 10 % of the lag's effect at 1 ms, 18 % at 4 ms and 21 % at 16 ms.
    equal_limits=(EqualLimit("clock_offset", "a lag of 4 ms at most", only_delays),),
)
