"""How far a leg's stiffness has drifted: forces at the same shaft angles, held against those of the first check.

At a given height and shaft angle a leg of springs pushes in proportion to their stiffness, so one factor between two checks says by how
much it changed. Weight, and friction that differs from touchdown to touchdown, are in what that factor leaves over.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from rfca_rig.recording.model import StaticStage


@dataclass(frozen=True)
class StiffnessDrift:
    """Change of the forces since the first check, as a share of them, and its standard error (nan from a single force)."""

    relative: float
    std: float

    def text(self) -> str:
        return f"{100.0 * self.relative:+.2f} +- {100.0 * self.std:.2f} %"


def stiffness_drift(stages: Sequence[StaticStage], holds: int, check: int) -> StiffnessDrift | None:
    """Of the check with that number, each of which is `holds` stages; None where it, or the first, is not whole.

    Least squares of fy and fz at all angles on those of the first check; the standard error is from what is left over.
    """
    by_number = {stage.stage: stage for stage in stages}
    first, now = _forces(by_number, holds, 1), _forces(by_number, holds, check)
    if first is None or now is None:
        return None
    weight = float(first @ first)
    factor = float(first @ now) / weight
    left_over = now - factor * first
    variance = float(left_over @ left_over) / (len(first) - 1) if len(first) > 1 else np.nan
    return StiffnessDrift(factor - 1.0, float(np.sqrt(variance / weight)))


def _forces(stages: Mapping[int, StaticStage], holds: int, check: int) -> np.ndarray | None:
    """(2 holds,) fy and fz of one check."""
    numbers = range((check - 1) * holds + 1, check * holds + 1)
    if not all(number in stages for number in numbers):
        return None
    return np.array([force for number in numbers for force in (stages[number].fy_N, stages[number].fz_N)])
