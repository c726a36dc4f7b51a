"""Fits along strokes that grow: first the beginning of every stroke, then more and more of it.

Soon after touchdown the forces follow smoothly from what the model supposes; later, what sticks, slips and hits a stop hangs on all that
was before, and the likelihood is full of walls. A descent on whole strokes that begins far away ends behind one of them; one that has the
beginnings right comes to the rest from nearby (as multiple shooting has it, Bock, Springer Ser. Chem. Phys. 18 (1981) 102).
"""

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor

import numpy as np

from rfca_rig.diagnosis.descent import Descent, Fitted
from rfca_rig.diagnosis.evidence import THREADS, Evidence, evidence_of
from rfca_rig.diagnosis.judging import judge_of
from rfca_rig.diagnosis.strokes import FlapCondition

BEGINNINGS = (0.3, 0.6, 0.8)  # of the way from touchdown to the valley, until which strokes have grown
KEPT = 3  # fits that go on where strokes have grown to the second of these


def grown(descent: Descent, fits: Sequence[Fitted]) -> list[Fitted]:
    """The best of these anew, effects as they stand and nuisances as believed in the beginning, along growing strokes to the whole.

    None where no stroke was recorded, and none of a fit for which the model has no answer on the way.
    """
    if not descent.evidence.flaps:
        return []
    first, *later = [_along(descent.evidence, share) for share in BEGINNINGS]
    here = _each_descended(first, [_as_believed(first, fitted) for fitted in fits])
    for step in (*later, descent):
        here = _each_descended(step, [step.at(fitted.coordinates, fitted.x) for fitted in here])
        here = sorted(here, key=step.log_evidence, reverse=True)[:KEPT]
    return [descent.polished(fitted) for fitted in here]


def _as_believed(step: Descent, fitted: Fitted) -> Fitted | None:
    nuisances = fitted.coordinates.nuisances
    return step.at(fitted.coordinates, np.concatenate([np.zeros(nuisances), fitted.x[nuisances:]]))


def _each_descended(step: Descent, begun: Sequence[Fitted | None]) -> list[Fitted]:
    """Those for which the model has an answer, each down from there."""
    with ThreadPoolExecutor(THREADS) as pool:
        return list(pool.map(step.descended, [begin for begin in begun if begin is not None]))


def _along(evidence: Evidence, share: float) -> Descent:
    """The descent on every stroke until that share of its way from touchdown to valley; what scatters is left to the model's error."""
    evidence = evidence_of([part.until(_moment_s(part, share)) if isinstance(part, FlapCondition) else part for part in evidence.parts])
    return Descent(evidence, judge_of(evidence.rows, np.empty((len(evidence.rows.measured), 0))))


def _moment_s(flap: FlapCondition, share: float) -> float:
    touchdown_s = flap.phases.touchdown_s
    return touchdown_s + share * (flap.phases.valley_s - touchdown_s)
