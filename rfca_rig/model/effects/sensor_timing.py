"""Effects of the force sensor on its time: clocks that differ, a lag, and its own ringing."""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from rfca_rig.model.declarations import sensor as declared
from rfca_rig.model.effect import EqualLimit, Parameter, Values
from rfca_rig.model.kernel.compiled import jit
from rfca_rig.model.setup import SensorOutput, Setup, with_sensor

Floats = NDArray[np.float64]

# Effects on time take the force as linear between the times at which it is simulated, which its
# jumps at touchdown and lift-off are not. Over a stroke (215 mm, 2.433 rad/s) with the force every
# 2, 1, 0.5 and 0.25 ms, readings are off by, in percent rms:
# - a clock that is late by 0.5 ms: 0.27, 0.12, 0 and 0; by 13.7 ms: 0.15, 0.08, 0.03 and 0.004
# - a sensor that rings at 40 Hz, ratio 0.06: 0.46, 0.11, 0.03 and 0.01; at 200 Hz, ratio 0.005:
#   2.3, 0.42, 0.14 and 0.07
CLOCKS_EVERY_S = 5e-4
FILTERS_EVERY_S = 2.5e-4


# A constant offset between the clocks of force sensor and shaft.


def apply_clock_offset(setup: Setup, values: Values) -> Setup:
    """A positive offset makes the force appear later than it was."""

    # Beyond the first and the last sample `np.interp` repeats the end values.
    def shift(felt: SensorOutput) -> SensorOutput:
        then = felt.t_s - values["offset_s"]
        fy, fz, tx = (
            np.interp(then, felt.t_s, channel) for channel in (felt.fy_N, felt.fz_N, felt.tx_Nm)
        )
        return replace(felt, fy_N=fy, fz_N=fz, tx_Nm=tx)

    return with_sensor(setup, shift, CLOCKS_EVERY_S)


CLOCK_OFFSET = declared.CLOCK_OFFSET.make_effect(
    parameters=(Parameter("offset_s", -0.05, 0.05),),
    apply=apply_clock_offset,
)


# A force clock that runs at another rate than the shaft's.


def apply_sensor_clock_rate(setup: Setup, values: Values) -> Setup:
    """With a positive rate the force appears too late after the beginning of the motion, in
    proportion to time, and too early before it.
    """

    def stretch(felt: SensorOutput) -> SensorOutput:
        then = felt.t_s * (1.0 - values["rate_relative"])
        fy, fz, tx = (
            np.interp(then, felt.t_s, channel) for channel in (felt.fy_N, felt.fz_N, felt.tx_Nm)
        )
        return replace(felt, fy_N=fy, fz_N=fz, tx_Nm=tx)

    return with_sensor(setup, stretch, CLOCKS_EVERY_S)


SENSOR_CLOCK_RATE = declared.SENSOR_CLOCK_RATE.make_effect(
    # A shift longer than a spike of the force changes the residual no longer in proportion to the
    # rate, so small rates are starts, too.
    parameters=(
        Parameter(
            "rate_relative",
            -0.03,
            0.03,
            below=0.5,
            starts=(-0.012, -0.004, -0.0015, 0.0015, 0.004, 0.012),
        ),
    ),
    apply=apply_sensor_clock_rate,
)


# First-order lag of all channels of the sensor.


def apply_sensor_lag(setup: Setup, values: Values) -> Setup:
    tau = values["time_constant_s"]

    def lag(felt: SensorOutput) -> SensorOutput:
        t = felt.t_s
        return replace(
            felt,
            fy_N=filter_first_order(t, felt.fy_N, tau),
            fz_N=filter_first_order(t, felt.fz_N, tau),
            tx_Nm=filter_first_order(t, felt.tx_Nm, tau),
        )

    return with_sensor(setup, lag, FILTERS_EVERY_S)


def filter_first_order(t_s: Floats, x: Floats, tau_s: float) -> Floats:
    """Output (m,) of y' = (x - y) / tau from rest for the input `x` (m,) at times `t_s` (m,);
    exact for x linear between samples.
    """
    # Two samples may have the same time; there nothing decays and nothing is added.
    step = np.diff(t_s) / tau_s
    left = np.exp(-step)
    ramp = (1.0 - left) / np.where(step > 0.0, step, 1.0)
    y = x.copy()
    fill_first_order(left, (ramp - left) * x[:-1] + (1.0 - ramp) * x[1:], y)
    return y


@jit
def fill_first_order(left: Floats, gained: Floats, y: Floats) -> None:
    """y (m,) from its first value on: of each value `left` (m - 1,) remains, `gained` (m - 1,)
    is added.
    """
    for i in range(gained.size):
        y[i + 1] = left[i] * y[i] + gained[i]


def lag_only_delays(values: Values) -> bool:
    """Whether the lag is so short that the forces do not change their shape."""
    return values["time_constant_s"] <= 4e-3


SENSOR_LAG = declared.SENSOR_LAG.make_effect(
    parameters=(Parameter("time_constant_s", 0.0005, 0.05, may_be_zero=False),),
    apply=apply_sensor_lag,
    # fy, fz and tx of two strokes up to lift-off: a fitted offset leaves 10 % of the lag's effect
    # at 1 ms, 18 % at 4 ms and 21 % at 16 ms.
    equal_limits=(EqualLimit(declared.CLOCK_OFFSET.id, "a lag of 4 ms at most", lag_only_delays),),
)


# A sensor that oscillates under its load: every channel passes a second-order low-pass.


def apply_sensor_ringing(setup: Setup, values: Values) -> Setup:
    """tx follows fy: both come from the motion of the sensor's top along y."""
    rate = 2.0 * np.pi * values["frequency_Hz"]
    ratio = values["damping_ratio"]
    across = rate * values["y_frequency_ratio"]

    def ring(felt: SensorOutput) -> SensorOutput:
        t = felt.t_s
        return replace(
            felt,
            fy_N=filter_second_order(t, felt.fy_N, across, ratio),
            fz_N=filter_second_order(t, felt.fz_N, rate, ratio),
            tx_Nm=filter_second_order(t, felt.tx_Nm, across, ratio),
        )

    return with_sensor(setup, ring, FILTERS_EVERY_S)


def filter_second_order(t_s: Floats, x: Floats, rate_rad_s: float, ratio: float) -> Floats:
    """Output (m,) of y'' + 2 d w y' + w^2 y = w^2 x from rest for the input `x` (m,) at times `t_s`
    (m,); `ratio` d is below 1.

    Exact for x linear between samples.
    """
    y = x.copy()
    fill_second_order(np.diff(t_s), x, rate_rad_s, ratio, y)
    return y


@jit
def fill_second_order(
    step_s: Floats, x: Floats, rate_rad_s: float, ratio: float, y: Floats
) -> None:
    """Fills `y` (m,) from its first value on. Where x is linear with slope s, y - (x - 2 d s /
    w) oscillates freely.
    """
    turning = rate_rad_s * np.sqrt(1.0 - ratio * ratio)
    decay = ratio * rate_rad_s
    speed = 0.0
    for i in range(step_s.size):
        h = step_s[i]
        if h <= 0.0:
            y[i + 1] = y[i]
            continue
        slope = (x[i + 1] - x[i]) / h
        behind = 2.0 * ratio * slope / rate_rad_s
        off = y[i] - x[i] + behind
        off_speed = speed - slope
        left = np.exp(-decay * h)
        cos = np.cos(turning * h)
        sin = np.sin(turning * h)
        mixed = (off_speed + decay * off) / turning
        y[i + 1] = x[i + 1] - behind + left * (off * cos + mixed * sin)
        speed = slope + left * (
            (mixed * turning - decay * off) * cos - (off * turning + decay * mixed) * sin
        )


def ringing_only_delays(values: Values) -> bool:
    """Whether the swing is so fast and so well damped that the forces do not change their shape."""
    return values["frequency_Hz"] >= 40.0 and values["damping_ratio"] >= 0.5


SENSOR_RINGING = declared.SENSOR_RINGING.make_effect(
    parameters=(
        # It oscillates, and a start whose frequency is off by a tenth is soon out of phase.
        Parameter(
            "frequency_Hz",
            8.0,
            200.0,
            may_be_zero=False,
            starts=tuple(8.0 * 1.12**n for n in range(28)),
        ),
        Parameter("damping_ratio", 0.005, 0.7, below=1.0, starts=(0.05,)),
    ),
    apply=apply_sensor_ringing,
    # At 25 Hz and a ratio of 0.05, fy over a stroke (215 mm, 2.433 rad/s) changes by 2.3 N rms at
    # 0.5 and 1.7 N at 2.
    shape=(Parameter("y_frequency_ratio", 0.5, 2.0, may_be_zero=False, neutral=1.0),),
    # fy, fz and tx of two strokes up to lift-off, a ratio of 0.5: a fitted offset leaves 20 % of
    # the effect at 40 Hz, 12 % at 150 Hz
    equal_limits=(
        EqualLimit(
            declared.CLOCK_OFFSET.id,
            "a fast and well damped swing only delays",
            ringing_only_delays,
        ),
    ),
)


EFFECTS = (
    CLOCK_OFFSET,
    SENSOR_CLOCK_RATE,
    SENSOR_LAG,
    SENSOR_RINGING,
)
