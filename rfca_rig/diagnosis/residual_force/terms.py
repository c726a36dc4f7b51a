"""Simple laws that a force at a place may follow: plain terms in what the motion offers, with units.

The course of a term comes from the simulated motion, which has no noise, never from a differentiated recording.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rfca_rig.diagnosis.residual_force.force_inputs import NominalCondition

Floats = NDArray[np.float64]

STILL = 1e-3  # share of the greatest speed below which a sign fades, so that rest has none


@dataclass(frozen=True)
class Signals:
    """Quantities that a force can depend on over one stroke of n samples, in SI units.

    `angle_rad` and `rate_rad_s` are (n, hinges), all others (n,). `t_s` counts from the command, `slip_m_s` is the speed of the tip along
    the floor, `gap_m` its height above it, and `load_N` the force of the floor on all ends.
    """

    t_s: Floats
    angle_rad: Floats
    rate_rad_s: Floats
    shaft_rad: Floats
    shaft_rad_s: Floats
    load_N: Floats
    slip_m_s: Floats
    gap_m: Floats
    along_m: Floats
    torque_Nm: Floats
    channels: dict[str, Floats]


def signals_of(here: NominalCondition) -> Signals:
    """The quantities in the nominal motion."""
    stroke, leg = here.stroke, here.supposed.rig.leg
    t_s, q, length = stroke.t_s, stroke.q_rad, np.array(leg.link_lengths_m)
    along = np.cos(q) @ length
    gap = here.flap.height_m + here.supposed.height_offset_m - leg.link_radius_m - np.sin(q) @ length
    return Signals(
        t_s=t_s,
        angle_rad=np.diff(q, axis=1),
        rate_rad_s=np.gradient(np.diff(q, axis=1), t_s, axis=0),
        shaft_rad=q[:, 0],
        shaft_rad_s=np.gradient(q[:, 0], t_s),
        load_N=stroke.normal_N.sum(axis=1),
        # The end of the last link is round and rolls, so the contact point moves by its radius per angle.
        slip_m_s=np.gradient(along - leg.link_radius_m * q[:, -1], t_s),
        gap_m=np.maximum(gap, 0.0),
        along_m=along,
        torque_Nm=stroke.shaft_torque_Nm,
        channels={signal: getattr(stroke, signal) for signal in here.flap.signals},
    )


@dataclass(frozen=True)
class Term:
    """`name` as in a formula, `unit` of its value ("" for none), and `course` over one stroke, (n,) or (n, hinges)."""

    name: str
    unit: str
    course: Callable[[Signals], Floats]


def _sign(x: Floats) -> Floats:
    """Smooth sign of x (n,), zero at rest."""
    return np.asarray(np.tanh(x / (STILL * np.abs(x).max() + 1e-12)))


_ALWAYS = (Term("1", "", lambda s: np.ones_like(s.t_s)), Term("t", "s", lambda s: np.maximum(s.t_s, 0.0)))

_HINGE = (
    Term("1", "", lambda s: np.ones_like(s.angle_rad)),
    Term("angle", "rad", lambda s: s.angle_rad),
    Term("|angle|", "rad", lambda s: np.abs(s.angle_rad)),
    Term("angle^3", "rad^3", lambda s: s.angle_rad**3),
    Term("sign(rate)", "", lambda s: _sign(s.rate_rad_s)),
    Term("rate", "rad/s", lambda s: s.rate_rad_s),
    Term("rate |rate|", "rad^2/s^2", lambda s: s.rate_rad_s * np.abs(s.rate_rad_s)),
    Term("|angle| sign(rate)", "rad", lambda s: np.abs(s.angle_rad) * _sign(s.rate_rad_s)),
    Term("angle t", "rad s", lambda s: s.angle_rad * np.maximum(s.t_s, 0.0)[:, None]),
)

_SHAFT = (
    *_ALWAYS,
    Term("sign(shaft rate)", "", lambda s: _sign(s.shaft_rad_s)),
    Term("shaft rate", "rad/s", lambda s: s.shaft_rad_s),
    Term("shaft rate |shaft rate|", "rad^2/s^2", lambda s: s.shaft_rad_s * np.abs(s.shaft_rad_s)),
    Term("shaft angle", "rad", lambda s: s.shaft_rad),
    Term("cos(shaft angle)", "", lambda s: np.cos(s.shaft_rad)),
    Term("sin(shaft angle)", "", lambda s: np.sin(s.shaft_rad)),
)

_FLOOR = (
    *_ALWAYS,
    Term("load", "N", lambda s: s.load_N),
    Term("sign(slip)", "", lambda s: _sign(s.slip_m_s)),
    Term("load sign(slip)", "N", lambda s: s.load_N * _sign(s.slip_m_s)),
    Term("slip", "m/s", lambda s: s.slip_m_s),
    Term("load slip", "N m/s", lambda s: s.load_N * s.slip_m_s),
    Term("touching", "", lambda s: (s.load_N > 0.0).astype(np.float64)),
    Term("1 / (1 + gap / 10 mm)^2", "", lambda s: 1.0 / (1.0 + s.gap_m / 0.01) ** 2),
    Term("way along the floor", "m", lambda s: s.along_m),
)

# Laws of an angle between shaft and leg. A constant one is a wrong start angle, which is a nuisance parameter already.
_TWIST = (
    *_ALWAYS[1:],
    Term("shaft torque", "N m", lambda s: s.torque_Nm),
    Term("sign(shaft torque)", "", lambda s: _sign(s.torque_Nm)),
    Term("shaft torque |shaft torque|", "N^2 m^2", lambda s: s.torque_Nm * np.abs(s.torque_Nm)),
    Term("shaft angle", "rad", lambda s: s.shaft_rad),
    Term("cos(shaft angle)", "", lambda s: np.cos(s.shaft_rad)),
    Term("sin(shaft angle)", "", lambda s: np.sin(s.shaft_rad)),
)


def library_of(place_id: str) -> tuple[Term, ...]:
    """The terms that make sense at a place."""
    if place_id.startswith("hinge"):
        return _HINGE
    if place_id in ("fy_N", "fz_N"):
        return (*_SHAFT, *_reading(place_id))
    if place_id == "shaft":
        return (*_SHAFT, *_reading("tx_Nm"))
    return _TWIST if place_id == "shaft_angle" else _FLOOR


def _reading(signal: str) -> tuple[Term, ...]:
    unit = {"N": "N", "Nm": "N m"}[signal.rsplit("_", 1)[1]]
    return (
        Term("reading", unit, lambda s: s.channels[signal]),
        Term("reading |reading|", f"({unit})^2", lambda s: s.channels[signal] * np.abs(s.channels[signal])),
        Term("reading^3", f"({unit})^3", lambda s: s.channels[signal] ** 3),
    )
