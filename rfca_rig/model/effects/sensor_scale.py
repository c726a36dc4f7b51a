"""Effects of the force sensor on its values: gain, crosstalk, saturation and drift of the zero."""

from dataclasses import replace

import numpy as np

from rfca_rig.model.declarations import sensor as declared
from rfca_rig.model.effect import Parameter, Values
from rfca_rig.model.setup import SensorOutput, Setup, with_sensor

# Wrong scale of all channels of the sensor.


def apply_sensor_gain(setup: Setup, values: Values) -> Setup:
    k = values["factor"]

    def scale(felt: SensorOutput) -> SensorOutput:
        return replace(felt, fy_N=k * felt.fy_N, fz_N=k * felt.fz_N, tx_Nm=k * felt.tx_Nm)

    return with_sensor(setup, scale)


SENSOR_GAIN = declared.SENSOR_GAIN.make_effect(
    parameters=(Parameter("factor", 0.8, 1.2),),
    apply=apply_sensor_gain,
)


# Crosstalk of the sensor from fy to fz.


def apply_sensor_crosstalk(setup: Setup, values: Values) -> Setup:
    def leak(felt: SensorOutput) -> SensorOutput:
        return replace(felt, fz_N=felt.fz_N + values["fz_per_fy"] * felt.fy_N)

    return with_sensor(setup, leak)


SENSOR_CROSSTALK = declared.SENSOR_CROSSTALK.make_effect(
    parameters=(Parameter("fz_per_fy", -0.2, 0.2),),
    apply=apply_sensor_crosstalk,
)


# Crosstalk between the channels of the sensor, as a matrix.


def apply_sensor_crosstalk_matrix(setup: Setup, values: Values) -> Setup:
    def leak(felt: SensorOutput) -> SensorOutput:
        fy = felt.fy_N
        fz = felt.fz_N
        tx = felt.tx_Nm
        return replace(
            felt,
            fy_N=fy + values["fy_per_fz"] * fz,
            fz_N=fz + values["fz_per_fy"] * fy,
            tx_Nm=tx + 1e-3 * (values["tx_per_fy_mm"] * fy + values["tx_per_fz_mm"] * fz),
        )

    return with_sensor(setup, leak)


SENSOR_CROSSTALK_MATRIX = declared.SENSOR_CROSSTALK_MATRIX.make_effect(
    parameters=(
        Parameter("fz_per_fy", -0.2, 0.2),
        Parameter("fy_per_fz", -0.2, 0.2),
        Parameter("tx_per_fy_mm", -10.0, 10.0),
        Parameter("tx_per_fz_mm", -10.0, 10.0),
    ),
    apply=apply_sensor_crosstalk_matrix,
)


# Saturation of fz: the reading does not exceed a limit.


def apply_sensor_saturation(setup: Setup, values: Values) -> Setup:
    """It acts on fz after all effects of the sensor that are stated before it."""
    limit_N = values["limit_N"]

    def clip(felt: SensorOutput) -> SensorOutput:
        return replace(felt, fz_N=np.clip(felt.fz_N, -limit_N, limit_N))

    return with_sensor(setup, clip)


SENSOR_SATURATION = declared.SENSOR_SATURATION.make_effect(
    # A limit above the force of the valley does nothing and gives no direction to a fit, so there
    # are several starts.
    parameters=(
        Parameter(
            "limit_N", 5.0, 100.0, may_be_zero=False, starts=tuple(8.0 * 1.15**n for n in range(16))
        ),
    ),
    apply=apply_sensor_saturation,
)


# Zero drift of fz with time.


def apply_sensor_drift(setup: Setup, values: Values) -> Setup:
    """The drift counts from the beginning of the motion, where every stroke is zeroed."""

    def drift(felt: SensorOutput) -> SensorOutput:
        return replace(felt, fz_N=felt.fz_N + values["rate_N_per_s"] * felt.t_s)

    return with_sensor(setup, drift)


SENSOR_DRIFT = declared.SENSOR_DRIFT.make_effect(
    parameters=(Parameter("rate_N_per_s", -10.0, 10.0),),
    apply=apply_sensor_drift,
)


EFFECTS = (
    SENSOR_GAIN,
    SENSOR_CROSSTALK,
    SENSOR_CROSSTALK_MATRIX,
    SENSOR_SATURATION,
    SENSOR_DRIFT,
)
