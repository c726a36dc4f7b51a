"""Drift of a leg's stiffness: forces at the same shaft angles, compared with those of the first check.

At a given height and shaft angle, a leg of springs pushes in proportion to their stiffness. One factor between two checks therefore
measures the change. The residual of that factor contains the weight, and friction that differs from touchdown to touchdown.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from rfca_rig.recording.model import StaticStage


@dataclass(frozen=True)
class StiffnessDrift:
    """Relative change of the forces since the first check, and its standard error (nan from a single force)."""

    relative: float
    std: float

    def text(self) -> str:
        return f"{100.0 * self.relative:+.2f} +- {100.0 * self.std:.2f} %"


def stiffness_drift(stages: Sequence[StaticStage], holds: int, check: int) -> StiffnessDrift | None:
    """Drift of check number `check`; None where this check or the first one is incomplete.

    Parameters
    ----------
    stages
        Static stages; each check consists of `holds` of them.
    holds
        Stages in one check.
    check
        Number of the check, from 1.

    Notes
    -----
    Least squares of fy and fz at all angles on those of the first check; the standard error comes from the residual.
    """
    by_number = {stage.stage: stage for stage in stages}
    first, now = _forces(by_number, holds, 1), _forces(by_number, holds, check)
    if first is None or now is None:
        return None
    # Regression through the origin: now = factor * first.
    weight = float(first @ first)
    factor = float(first @ now) / weight
    residual = now - factor * first
    variance = float(residual @ residual) / (len(first) - 1) if len(first) > 1 else np.nan
    return StiffnessDrift(factor - 1.0, float(np.sqrt(variance / weight)))


def _forces(stages: Mapping[int, StaticStage], holds: int, check: int) -> np.ndarray | None:
    """(2 holds,) fy and fz of one check."""
    numbers = range((check - 1) * holds + 1, check * holds + 1)
    if not all(number in stages for number in numbers):
        return None
    return np.array([force for number in numbers for force in (stages[number].fy_N, stages[number].fz_N)])
