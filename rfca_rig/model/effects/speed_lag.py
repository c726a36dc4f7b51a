"""Joint speeds are read through a first-order lag, later than the angles."""

from rfca_rig.model.effect import Effect, Parameter, Values
from rfca_rig.model.setup import Setup, with_late_readings


def apply(setup: Setup, values: Values) -> Setup:
    """The setup with the lag. Raises BadInput for a rig whose joint angles are not recorded."""
    return with_late_readings(setup, "speed_lag", speed_lag_s=values["time_constant_s"])


EFFECT = Effect(
    id="speed_lag",
    where="pendulum-like rigs",
    left_out="joint speeds are read later than the angles",
    law="tau y' = x - y for speeds alone",
    source="first-order low-pass",
    parameters=(Parameter("time_constant_s", 0.002, 0.05, below=0.1),),
    apply=apply,
)
