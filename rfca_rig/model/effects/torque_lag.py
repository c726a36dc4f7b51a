"""Joint torques that follow the recorded ones with a first-order lag, as those of a torque-controlled drive."""

from rfca_rig.model.effect import Effect, Parameter, Values
from rfca_rig.model.joint_drive import with_drives
from rfca_rig.model.setup import Setup


def apply(setup: Setup, values: Values) -> Setup:
    """Two lags in series count as one with the sum of their time constants. Raises BadInput for a rig without torque-driven joints."""
    return with_drives(setup, "torque_lag", lambda drive: (*drive[:2], drive[2] + values["time_constant_s"]))


EFFECT = Effect(
    id="torque_lag",
    where="pendulum-like rigs",
    left_out="joint torques follow the recorded ones with a lag",
    law="tau_lag tau' = tau_recorded - tau",
    source="first-order current loop of a motor",
    parameters=(Parameter("time_constant_s", 0.002, 0.05, below=0.1),),
    apply=apply,
)
