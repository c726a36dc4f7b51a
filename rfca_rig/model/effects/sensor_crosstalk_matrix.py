"""Crosstalk between the channels of the sensor, as a matrix."""

from dataclasses import replace

from rfca_rig.model.effect import Effect, Parameter, Values
from rfca_rig.model.setup import SensorOutput, Setup, with_sensor


def apply(setup: Setup, values: Values) -> Setup:
    def leak(felt: SensorOutput) -> SensorOutput:
        fy, fz, tx = felt.fy_N, felt.fz_N, felt.tx_Nm
        return replace(
            felt,
            fy_N=fy + values["fy_per_fz"] * fz,
            fz_N=fz + values["fz_per_fy"] * fy,
            tx_Nm=tx + 1e-3 * (values["tx_per_fy_mm"] * fy + values["tx_per_fz_mm"] * fz),
        )

    return with_sensor(setup, leak)


EFFECT = Effect(
    id="sensor_crosstalk_matrix",
    where="sensor",
    left_out="channels leak into each other",
    law="(fy, fz, tx) times a matrix with ones on its diagonal; no leak of tx",
    source="off-diagonal terms of the calibration matrix; tx_per_fz is also a sensor beside the shaft, tx_per_fy one of another height",
    parameters=(
        Parameter("fz_per_fy", -0.2, 0.2),
        Parameter("fy_per_fz", -0.2, 0.2),
        Parameter("tx_per_fy_mm", -10.0, 10.0),
        Parameter("tx_per_fz_mm", -10.0, 10.0),
    ),
    apply=apply,
)
