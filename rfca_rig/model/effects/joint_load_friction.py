"""Dry friction in proportion to the torque that a joint's gear transmits: an efficiency below one, with stick."""

from dataclasses import replace
from typing import Any

from rfca_rig.errors import BadInput
from rfca_rig.model.effect import Effect, Parameter, Values
from rfca_rig.model.effects.joint_friction import DAMPING_S, PRESLIDING_RAD
from rfca_rig.model.joint_drive import CLOCK, is_drive, torque_at
from rfca_rig.model.laws import HINGE, LawUse
from rfca_rig.model.setup import Setup


def torque(phi: float, rate: float, elapsed: float, k0: float, k2: float, memory: Any, parameter: Any) -> tuple[float, float, float]:
    # parameter = (loss, presliding, damping time, and the recorded torque); dry friction whose limit follows the torque.
    most = parameter[0] * abs(torque_at(memory[CLOCK] + elapsed, parameter))
    stiffness = most / parameter[1]
    stuck = stiffness * (phi - memory[0] + parameter[2] * rate)
    if stuck > most:
        return most, 0.0, 0.0
    if stuck < -most:
        return -most, 0.0, 0.0
    return stuck, stiffness, stiffness * parameter[2]


def advance(phi: float, rate: float, elapsed: float, k0: float, k2: float, memory: Any, parameter: Any) -> None:
    memory[0] = min(max(memory[0], phi - parameter[1]), phi + parameter[1])
    memory[CLOCK] += elapsed


def apply(setup: Setup, values: Values) -> Setup:
    """Raises BadInput for a rig without torque-driven joints, on which it would do nothing."""
    joints = [use.only for use in setup.laws if is_drive(use)]
    if not joints:
        raise BadInput("effect joint_load_friction: no joint of this rig is driven by a recorded torque; leave it out")
    parameters = (values["loss_relative"], PRESLIDING_RAD, DAMPING_S)
    laws = tuple(LawUse(HINGE, torque, parameters, advance, joint, reads_torque=True) for joint in joints)
    return replace(setup, laws=(*setup.laws, *laws))


EFFECT = Effect(
    id="joint_load_friction",
    where="pendulum-like rigs",
    left_out="friction of the gears that grows with the torque they transmit",
    law="T = loss |tau| sgn(phi'), stuck below it; the efficiency is 1 - loss where the motor drives the joint",
    source="Hamon, Gautier and Garrec, IROS 2010, dry friction that depends on load; tau is the torque of the drive",
    parameters=(Parameter("loss_relative", 0.01, 0.6, below=1.0),),
    apply=apply,
)
