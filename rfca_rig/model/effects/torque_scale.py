"""Joints that turn with another torque than recorded: a wrong torque constant of the motors, or losses in proportion to the torque."""

from dataclasses import replace

from rfca_rig.errors import BadInput
from rfca_rig.model.effect import Effect, Parameter, Values
from rfca_rig.model.joint_drive import is_drive
from rfca_rig.model.setup import Setup


def apply(setup: Setup, values: Values) -> Setup:
    """Raises BadInput for a rig without torque-driven joints, on which it would do nothing."""
    if not any(is_drive(use) for use in setup.laws):
        raise BadInput("effect torque_scale: no joint of this rig is driven by a recorded torque; leave it out")
    laws = (replace(use, parameters=(use.parameters[0] * values["factor"],)) if is_drive(use) else use for use in setup.laws)
    return replace(setup, laws=tuple(laws))


EFFECT = Effect(
    id="torque_scale",
    where="pendulum-like rigs",
    left_out="scale of the recorded joint torques wrong",
    law="tau = factor tau_recorded",
    source="torque constant of the motors",
    parameters=(Parameter("factor", 0.3, 3.0),),
    apply=apply,
)
