"""Joint torques in proportion to the recorded ones: a wrong torque constant of the motors, or losses in proportion to the torque."""

from rfca_rig.model.effect import Effect, Parameter, Values
from rfca_rig.model.joint_drive import with_drives
from rfca_rig.model.setup import Setup


def apply(setup: Setup, values: Values) -> Setup:
    """Raises BadInput for a rig without torque-driven joints, on which it would do nothing."""
    return with_drives(setup, "torque_scale", lambda drive: (drive[0] * values["factor"], *drive[1:]))


EFFECT = Effect(
    id="torque_scale",
    where="pendulum-like rigs",
    left_out="scale of the recorded joint torques wrong",
    law="tau = factor tau_recorded",
    source="torque constant of the motors",
    parameters=(Parameter("factor", 0.3, 3.0),),
    apply=apply,
)
