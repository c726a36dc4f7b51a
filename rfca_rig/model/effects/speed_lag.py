"""Joint speeds are read later than the angles, as from a filter."""

from dataclasses import replace

from rfca_rig.errors import BadInput
from rfca_rig.model.effect import Effect, Parameter, Values
from rfca_rig.model.setup import Setup


def apply(setup: Setup, values: Values) -> Setup:
    """Two lags in a row count as one of their sum. Raises BadInput for a rig whose joint angles are not recorded."""
    readings = setup.joint_readings
    if readings is None:
        raise BadInput("effect speed_lag: the joint angles of this rig are not recorded; leave it out")
    return replace(setup, joint_readings=replace(readings, speed_lag_s=readings.speed_lag_s + values["time_constant_s"]))


EFFECT = Effect(
    id="speed_lag",
    where="pendulum-like rigs",
    left_out="joint speeds are read later than the angles",
    law="tau y' = x - y for speeds alone",
    source="first-order low-pass",
    parameters=(Parameter("time_constant_s", 0.002, 0.05, below=0.1),),
    apply=apply,
)
