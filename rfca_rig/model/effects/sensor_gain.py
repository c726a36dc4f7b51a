"""Wrong scale of all channels of the sensor."""

from dataclasses import replace

from rfca_rig.model.effect import Effect, Parameter, Values
from rfca_rig.model.setup import SensorOutput, Setup, with_sensor


def apply(setup: Setup, values: Values) -> Setup:
    k = values["factor"]

    def scale(felt: SensorOutput) -> SensorOutput:
        return replace(felt, fy_N=k * felt.fy_N, fz_N=k * felt.fz_N, tx_Nm=k * felt.tx_Nm)

    return with_sensor(setup, scale)


EFFECT = Effect(
    id="sensor_gain",
    where="sensor",
    left_out="force scale wrong",
    law="all channels times a factor",
    source="calibration",
    parameters=(Parameter("factor", 0.8, 1.2),),
    apply=apply,
)
