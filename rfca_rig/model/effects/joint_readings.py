"""Effects on how the joints of a pendulum are read: angles and speeds late."""

from rfca_rig.model.effect import Effect, Parameter, Values
from rfca_rig.model.setup import Setup, with_late_readings

# Joint angles and speeds are read through a first-order lag, as of a filter.


def apply_angle_lag(setup: Setup, values: Values) -> Setup:
    """The setup with the lag. Raises BadInput for a rig whose joint angles are not recorded."""
    return with_late_readings(setup, "angle_lag", angle_lag_s=values["time_constant_s"])


ANGLE_LAG = Effect(
    id="angle_lag",
    where="pendulum-like rigs",
    left_out="joint angles and speeds are read through a lag",
    law="tau y' = x - y for angles and speeds",
    source="first-order low-pass",
    parameters=(Parameter("time_constant_s", 0.002, 0.05, below=0.1),),
    apply=apply_angle_lag,
)


# Joint speeds are read through a first-order lag, later than the angles.


def apply_speed_lag(setup: Setup, values: Values) -> Setup:
    """The setup with the lag. Raises BadInput for a rig whose joint angles are not recorded."""
    return with_late_readings(setup, "speed_lag", speed_lag_s=values["time_constant_s"])


SPEED_LAG = Effect(
    id="speed_lag",
    where="pendulum-like rigs",
    left_out="joint speeds are read later than the angles",
    law="tau y' = x - y for speeds alone",
    source="first-order low-pass",
    parameters=(Parameter("time_constant_s", 0.002, 0.05, below=0.1),),
    apply=apply_speed_lag,
)


EFFECTS = (
    ANGLE_LAG,
    SPEED_LAG,
)
