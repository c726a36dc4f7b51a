"""What every hypothesis may move: the values of [known_to], the numbers of the floor that nobody measures, and a leg that has not
quite come to rest when the recording begins. Of the shaft's own motion: how late the drive does what it is told."""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from rfca_rig.analysis.fitting.parameters import PARAMETERS, Supposed, space_of
from rfca_rig.analysis.fitting.space import FitParameter, Space
from rfca_rig.model.parameters import RigModel, Swing

# how a floor ties and drags a point beside mu N, how high in a deep print, and what it damps of a point that leaves
SELDOM_MEASURED = ("presliding", "tangential_damping", "friction_rise", "leaving_damping")
LATE_MS = 2.0  # an adapter, a bus and a drive's own cycle; a gain of its loop does much the same
SAGS = 0.3  # a leg let go straight half a second before still swings by a third of its sag
SAGS_PER_S = 25.0  # the same as a speed, at the 13 Hz of the paper's leg


def nuisances_of(rig: RigModel, known_to: Mapping[str, float], before_s: float) -> Space[Supposed]:
    """The space of all nuisances; `before_s` is how long before the start the recording begins.

    Those that hardly anybody measures have their usual spread where [known_to] has no key for them; a key of 0 leaves them out.
    """
    swinging = replace(rig, swing=Swing(before_s, 0.0, 0.0)) if before_s > 0.0 else rig
    listed = {p.name for p in PARAMETERS.values() if p.known_to in known_to}
    names = [p.name for p in PARAMETERS.values() if p.name in listed.union(SELDOM_MEASURED) and _prior_std(p, known_to) > 0.0]
    space = space_of(names, Supposed(swinging), known_to) if names else Space((), Supposed(swinging), np.empty(0), np.empty(0, dtype=bool))
    space = replace(space, has_prior=np.ones(len(space.std), dtype=bool))
    return _joined(space, _SWING, known_to) if before_s > 0.0 else space


def nuisances_of_drive(rig: RigModel, centre: Supposed, known_to: Mapping[str, float]) -> Space[Supposed]:
    """The space of what the shaft's own motion hardly depends on, and of what it does, around what is supposed of the leg."""
    stated = {key: known_to[key] for name in SELDOM_MEASURED if (key := PARAMETERS[name].known_to or "") in known_to}
    space = nuisances_of(rig, {**stated, "friction_coefficient": 0.01, "height_mm": 0.1}, 0.0)
    return _joined(replace(space, centre=centre), (_DELAY,), known_to)


def _prior_std(parameter: FitParameter[Supposed], known_to: Mapping[str, float]) -> float:
    return known_to.get(parameter.known_to or "", parameter.spread)


def _joined(space: Space[Supposed], more: tuple[FitParameter[Supposed], ...], known_to: Mapping[str, float]) -> Space[Supposed]:
    free = tuple(p for p in more if _prior_std(p, known_to) > 0.0)
    return replace(
        space,
        parameters=(*space.parameters, *free),
        std=np.append(space.std, [_prior_std(p, known_to) for p in free]),
        has_prior=np.append(space.has_prior, np.ones(len(free), dtype=bool)),
    )


def _swing(at: Supposed) -> Swing:
    return at.rig.swing or Swing(0.0, 0.0, 0.0)


def _with_share(at: Supposed, share: float) -> Supposed:
    return replace(at, rig=replace(at.rig, swing=replace(_swing(at), share=share)))


def _with_rate(at: Supposed, rate_per_s: float) -> Supposed:
    return replace(at, rig=replace(at.rig, swing=replace(_swing(at), rate_per_s=rate_per_s)))


_SWING = (
    FitParameter("swing", "sags", False, SAGS, lambda at: _swing(at).share, _with_share, "swing_sags"),
    FitParameter("swing_rate", "sags/s", False, SAGS_PER_S, lambda at: _swing(at).rate_per_s, _with_rate, "swing_sags_per_s"),
)

_DELAY: FitParameter[Supposed] = FitParameter(
    "command_delay", "ms", False, LATE_MS, lambda at: 1e3 * at.command_delay_s, lambda at, ms: replace(at, command_delay_s=1e-3 * ms),
    "command_delay_ms",
)  # fmt: skip
