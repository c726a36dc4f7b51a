"""Dry friction with stick, as a law of hinges and joints.

A stuck pin yields like a stiff spring with a damper, so that it comes to rest instead of ringing: real contacts lose energy in their
micro-slip long before they slide. Both together never exceed the friction torque, and the spring's anchor is dragged along beyond it.
Presliding as of Dahl, damped as in LuGre (Canudas de Wit et al. 1995). How much of the friction a stuck pin bears at rest depends on
how it got there; it is a parameter of the law.
"""

from typing import Any

from rfca_rig.model.laws import HINGE, LawUse

AT_REST_S = 1e6  # longer since the last step: an equilibrium is looked for


def torque(phi: float, rate: float, elapsed: float, k0: float, k2: float, memory: Any, parameter: Any) -> tuple[float, float, float]:
    stiffness = parameter[0] / parameter[1]
    stuck = stiffness * (phi - memory[0] + parameter[2] * rate)
    share = 1.0 - parameter[3] if elapsed > AT_REST_S else 1.0
    if stuck > parameter[0]:
        return share * parameter[0], 0.0, 0.0
    if stuck < -parameter[0]:
        return -share * parameter[0], 0.0, 0.0
    return share * stuck, share * stiffness, share * stiffness * parameter[2]


def advance(phi: float, rate: float, elapsed: float, k0: float, k2: float, memory: Any, parameter: Any) -> None:
    if elapsed > AT_REST_S:
        bent = min(max(phi - memory[0], -parameter[1]), parameter[1])
        memory[0] = phi - (1.0 - parameter[3]) * bent
    memory[0] = min(max(memory[0], phi - parameter[1]), phi + parameter[1])


def dry_friction(torque_Nm: float, presliding_rad: float, damping_s: float, only: int = -1, let_go: float = 0.0) -> LawUse:
    """The law on one hinge or joint, or on all: it slips after `presliding_rad`; damper over spring is `damping_s`.

    At rest a pin holds against being bent from straight, `let_go` 0, or bears nothing, 1, or pushes the other way, 2.
    """
    return LawUse(HINGE, torque, (torque_Nm, presliding_rad, damping_s, let_go), advance, only)
