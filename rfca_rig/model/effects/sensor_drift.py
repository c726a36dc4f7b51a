"""Zero drift of fz with time."""

from dataclasses import replace

from rfca_rig.model.effect import Effect, Parameter, Values
from rfca_rig.model.setup import SensorOutput, Setup, with_sensor


def apply(setup: Setup, values: Values) -> Setup:
    """The drift counts from the beginning of the motion, where every stroke is zeroed."""

    def drift(felt: SensorOutput) -> SensorOutput:
        return replace(felt, fz_N=felt.fz_N + values["rate_N_per_s"] * felt.t_s)

    return with_sensor(setup, drift)


EFFECT = Effect(
    id="sensor_drift",
    where="sensor",
    left_out="fz drifts with time",
    law="fz + rate t",
    source="thermal drift of a strain-gauge bridge",
    parameters=(Parameter("rate_N_per_s", -10.0, 10.0),),
    apply=apply,
)
