"""Dry friction with stick, as a law of hinges and joints.

A stuck pin yields like a stiff spring with a damper, so that it comes to rest instead of ringing: real contacts lose energy in their
micro-slip long before they slide. Both together never exceed the friction torque, and the spring's anchor is dragged along beyond it.
Presliding as of Dahl, damped as in LuGre (Canudas de Wit et al. 1995).
"""

from typing import Any

from rfca_rig.model.laws import HINGE, LawUse


def torque(phi: float, rate: float, elapsed: float, k0: float, k2: float, memory: Any, parameter: Any) -> tuple[float, float, float]:
    stiffness = parameter[0] / parameter[1]
    stuck = stiffness * (phi - memory[0] + parameter[2] * rate)
    if stuck > parameter[0]:
        return parameter[0], 0.0, 0.0
    if stuck < -parameter[0]:
        return -parameter[0], 0.0, 0.0
    return stuck, stiffness, stiffness * parameter[2]


def advance(phi: float, rate: float, elapsed: float, k0: float, k2: float, memory: Any, parameter: Any) -> None:
    memory[0] = min(max(memory[0], phi - parameter[1]), phi + parameter[1])


def dry_friction(torque_Nm: float, presliding_rad: float, damping_s: float, only: int = -1) -> LawUse:
    """The law on one hinge or joint, or on all: it slips after `presliding_rad`; damper over spring is `damping_s`."""
    return LawUse(HINGE, torque, (torque_Nm, presliding_rad, damping_s), advance, only)
