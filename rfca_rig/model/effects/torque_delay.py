"""Recorded joint torques whose time stamps are off against those of the angles."""

from rfca_rig.model.effect import Effect, Parameter, Values
from rfca_rig.model.joint_drive import with_drives
from rfca_rig.model.setup import Setup


def apply(setup: Setup, values: Values) -> Setup:
    """Raises BadInput for a rig without torque-driven joints, on which it would do nothing."""
    return with_drives(setup, "torque_delay", lambda drive: (drive[0], drive[1] + values["delay_s"], *drive[2:]))


EFFECT = Effect(
    id="torque_delay",
    where="pendulum-like rigs",
    left_out="joint torques act later than recorded (a negative delay: they were recorded late)",
    law="tau(t) = tau_recorded(t - delay)",
    source="dead time of a drive that is told a torque; the other way round, of the current sensor and its bus",
    parameters=(Parameter("delay_s", -0.04, 0.04, below=0.1),),
    apply=apply,
)
