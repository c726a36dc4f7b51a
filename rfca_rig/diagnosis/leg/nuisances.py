"""Nuisance parameters of the leg: what every hypothesis may change within its prior.

- the values of [known_to]
- four ground parameters that are seldom measured
- the swing of a leg that is not quite at rest when the recording begins
- for the motion of the shaft, the delay of the drive

Section 3 of docs/method.md lists them.
"""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from rfca_rig.analysis.fitting.parameters import PARAMETERS, ModelPoint, make_prior
from rfca_rig.analysis.fitting.space import FitParameter, Prior
from rfca_rig.model.parameters import RigModel, Swing

# Beside the friction coefficient: presliding, tangential damping, friction rise in a deep print, and damping of a point that leaves.
SELDOM_MEASURED = ("presliding", "tangential_damping", "friction_rise", "leaving_damping")
LATE_MS = 2.0  # an adapter, a bus and a drive's own cycle; a gain of its loop does much the same
SAGS = 0.3  # a leg that was released straight half a second before still swings by a third of its sag
SAGS_PER_S = 25.0  # the same as a speed, at the 13 Hz of the paper's leg


def nuisances_of(rig: RigModel, known_to: Mapping[str, float], before_s: float) -> Prior[ModelPoint]:
    """Space of all nuisance parameters of the leg.

    Parameters
    ----------
    rig
        The nominal model.
    known_to
        Standard uncertainties by key. Parameters that are seldom measured have a usual prior without a key; a key of 0 makes a value exact.
    before_s
        How long before the start of the motion the recording begins.
    """
    # Before the motion begins, a free swing of the leg can show; without such samples it cannot be fitted.
    swinging = replace(rig, swing=Swing(before_s, 0.0, 0.0)) if before_s > 0.0 else rig
    listed = {p.name for p in PARAMETERS.values() if p.known_to in known_to}
    names = [p.name for p in PARAMETERS.values() if p.name in listed.union(SELDOM_MEASURED) and _prior_std(p, known_to) > 0.0]
    space = (
        make_prior(names, ModelPoint(swinging), known_to)
        if names
        else Prior((), ModelPoint(swinging), np.empty(0), np.empty(0, dtype=bool))
    )
    space = replace(space, has_prior=np.ones(len(space.std), dtype=bool))
    return _extend(space, _SWING, known_to) if before_s > 0.0 else space


def nuisances_of_drive(rig: RigModel, centre: ModelPoint, known_to: Mapping[str, float]) -> Prior[ModelPoint]:
    """Space of the nuisance parameters of the shaft's motion, around the leg in `centre`."""
    # The leg is taken from the forces. Only ground, friction and height stay free, since the shaft hardly depends on them.
    stated = {key: known_to[key] for name in SELDOM_MEASURED if (key := PARAMETERS[name].known_to or "") in known_to}
    space = nuisances_of(rig, {**stated, "friction_coefficient": 0.01, "height_mm": 0.1}, 0.0)
    return _extend(replace(space, centre=centre), (_DELAY,), known_to)


def _prior_std(parameter: FitParameter[ModelPoint], known_to: Mapping[str, float]) -> float:
    return known_to.get(parameter.known_to or "", parameter.spread)


def _extend(space: Prior[ModelPoint], more: tuple[FitParameter[ModelPoint], ...], known_to: Mapping[str, float]) -> Prior[ModelPoint]:
    free = tuple(p for p in more if _prior_std(p, known_to) > 0.0)
    return replace(
        space,
        parameters=(*space.parameters, *free),
        std=np.append(space.std, [_prior_std(p, known_to) for p in free]),
        has_prior=np.append(space.has_prior, np.ones(len(free), dtype=bool)),
    )


def _swing(at: ModelPoint) -> Swing:
    return at.rig.swing or Swing(0.0, 0.0, 0.0)


def _with_share(at: ModelPoint, share: float) -> ModelPoint:
    return replace(at, rig=replace(at.rig, swing=replace(_swing(at), share=share)))


def _with_rate(at: ModelPoint, rate_per_s: float) -> ModelPoint:
    return replace(at, rig=replace(at.rig, swing=replace(_swing(at), rate_per_s=rate_per_s)))


_SWING = (
    FitParameter("swing", "sags", False, SAGS, lambda at: _swing(at).share, _with_share, "swing_sags"),
    FitParameter("swing_rate", "sags/s", False, SAGS_PER_S, lambda at: _swing(at).rate_per_s, _with_rate, "swing_sags_per_s"),
)

_DELAY: FitParameter[ModelPoint] = FitParameter(
    "command_delay", "ms", False, LATE_MS, lambda at: 1e3 * at.command_delay_s, lambda at, ms: replace(at, command_delay_s=1e-3 * ms),
    "command_delay_ms",
)  # fmt: skip
