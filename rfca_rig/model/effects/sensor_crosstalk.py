"""Crosstalk of the sensor from fy to fz."""

from dataclasses import replace

from rfca_rig.model.effect import Effect, Parameter, Values
from rfca_rig.model.setup import SensorOutput, Setup, with_sensor


def apply(setup: Setup, values: Values) -> Setup:
    def leak(felt: SensorOutput) -> SensorOutput:
        return replace(felt, fz_N=felt.fz_N + values["fz_per_fy"] * felt.fy_N)

    return with_sensor(setup, leak)


EFFECT = Effect(
    id="sensor_crosstalk",
    where="sensor",
    left_out="fy leaks into fz",
    law="fz + c fy",
    source="off-diagonal term of the calibration matrix",
    parameters=(Parameter("fz_per_fy", -0.2, 0.2),),
    apply=apply,
    variant_of="sensor_crosstalk_matrix",
)
