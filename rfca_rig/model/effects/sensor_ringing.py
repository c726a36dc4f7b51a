"""A sensor that oscillates under its load: every channel passes a second-order low-pass."""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from rfca_rig.model.compiled import jit
from rfca_rig.model.effect import Effect, EqualLimit, Parameter, Values
from rfca_rig.model.setup import SensorOutput, Setup, with_sensor

Floats = NDArray[np.float64]


def apply(setup: Setup, values: Values) -> Setup:
    """tx follows fy: both come from the motion of the sensor's top along y."""
    rate, ratio = 2.0 * np.pi * values["frequency_Hz"], values["damping_ratio"]
    across = rate * values["y_frequency_ratio"]

    def ring(felt: SensorOutput) -> SensorOutput:
        t = felt.t_s
        return replace(
            felt,
            fy_N=filter_second_order(t, felt.fy_N, across, ratio),
            fz_N=filter_second_order(t, felt.fz_N, rate, ratio),
            tx_Nm=filter_second_order(t, felt.tx_Nm, across, ratio),
        )

    return with_sensor(setup, ring)


def filter_second_order(t_s: Floats, x: Floats, rate_rad_s: float, ratio: float) -> Floats:
    """Output (m,) of y'' + 2 d w y' + w^2 y = w^2 x from rest for the input `x` (m,) at times `t_s` (m,); `ratio` d is below 1.

    Exact for x linear between samples.
    """
    y = x.copy()
    fill_second_order(np.diff(t_s), x, rate_rad_s, ratio, y)
    return y


@jit
def fill_second_order(step_s: Floats, x: Floats, rate_rad_s: float, ratio: float, y: Floats) -> None:
    """Fills `y` (m,) from its first value on. Where x is linear with slope s, y - (x - 2 d s / w) oscillates freely."""
    turning, decay, speed = rate_rad_s * np.sqrt(1.0 - ratio * ratio), ratio * rate_rad_s, 0.0
    for i in range(step_s.size):
        h = step_s[i]
        if h <= 0.0:
            y[i + 1] = y[i]
            continue
        slope = (x[i + 1] - x[i]) / h
        behind = 2.0 * ratio * slope / rate_rad_s
        off, off_speed = y[i] - x[i] + behind, speed - slope
        left, cos, sin = np.exp(-decay * h), np.cos(turning * h), np.sin(turning * h)
        mixed = (off_speed + decay * off) / turning
        y[i + 1] = x[i + 1] - behind + left * (off * cos + mixed * sin)
        speed = slope + left * ((mixed * turning - decay * off) * cos - (off * turning + decay * mixed) * sin)


def only_delays(values: Values) -> bool:
    """Whether the swing is so fast and so well damped that the forces do not change their shape."""
    return values["frequency_Hz"] >= 40.0 and values["damping_ratio"] >= 0.5


EFFECT = Effect(
    id="sensor_ringing",
    where="sensor",
    left_out="the sensor swings under its load",
    law="y'' + 2 d w y' + w^2 y = w^2 x for every channel",
    source="one mode of vibration of the sensor with what is bolted to it: Ewins, Modal Testing, 2000",
    parameters=(
        # It oscillates, and a start whose frequency is off by a tenth is soon out of phase.
        Parameter("frequency_Hz", 8.0, 200.0, may_be_zero=False, starts=tuple(8.0 * 1.12**n for n in range(28))),
        Parameter("damping_ratio", 0.005, 0.7, below=1.0, starts=(0.05,)),
    ),
    apply=apply,
    # At 25 Hz and a ratio of 0.05, fy over a stroke (215 mm, 2.433 rad/s) changes by 2.3 N rms at 0.5 and 1.7 N at 2.
    shape=(Parameter("y_frequency_ratio", 0.5, 2.0, may_be_zero=False, neutral=1.0),),
    # fy, fz and tx of two strokes up to lift-off, a ratio of 0.5: a fitted offset leaves 20 % of the effect at 40 Hz, 12 % at 150 Hz
    equal_limits=(
        EqualLimit(
            "clock_offset",
            "a fast and well damped swing only delays",
            only_delays,
        ),
    ),
)
