"""Dry friction with stick, as a law of hinges and joints.

A stuck pin yields like a stiff spring with a damper, so that it comes to rest instead of ringing: real contacts lose energy in their
micro-slip long before they slide. The sum of both never exceeds the friction torque; beyond it, the spring's anchor moves with the pin.
Presliding as of Dahl, damped as in LuGre (Canudas de Wit et al. 1995). The friction of a stuck pin at rest depends on
its path; it is a parameter of the law.
"""

from typing import Any

from rfca_rig.model.laws import HINGE, LawUse

# A longer time since the last step means that `equilibrium` is seeking a rest pose.
AT_REST_S = 1e6


def torque(phi: float, rate: float, elapsed: float, k0: float, k2: float, memory: Any, parameter: Any) -> tuple[float, float, float]:
    # parameter = (friction torque, presliding, damping time, let_go); memory[0] is the anchor's angle.
    stiffness = parameter[0] / parameter[1]
    stuck = stiffness * (phi - memory[0] + parameter[2] * rate)
    share = 1.0 - parameter[3] if elapsed > AT_REST_S else 1.0
    if stuck > parameter[0]:
        return share * parameter[0], 0.0, 0.0
    if stuck < -parameter[0]:
        return -share * parameter[0], 0.0, 0.0
    return share * stuck, share * stiffness, share * stiffness * parameter[2]


def advance(phi: float, rate: float, elapsed: float, k0: float, k2: float, memory: Any, parameter: Any) -> None:
    # At rest the anchor is put where the spring gives the torque with which the pose was found.
    if elapsed > AT_REST_S:
        bent = min(max(phi - memory[0], -parameter[1]), parameter[1])
        memory[0] = phi - (1.0 - parameter[3]) * bent
    memory[0] = min(max(memory[0], phi - parameter[1]), phi + parameter[1])


def dry_friction(torque_Nm: float, presliding_rad: float, damping_s: float, only: int = -1, let_go: float = 0.0) -> LawUse:
    """The law on one hinge or joint, or on all: it slips after `presliding_rad`; the damping is `damping_s` times the stiffness.

    `let_go` is how much less of the bending a pin resists at rest: 0 resists it in full, 1 has no torque, 2 acts the other way.
    """
    return LawUse(HINGE, torque, (torque_Nm, presliding_rad, damping_s, let_go), advance, only)
