"""Fits along conditions that grow: first the beginning of every condition, then more and more of it.

In the beginning the signals follow smoothly from what the model supposes; later, what sticks, slips and hits a stop hangs on all that
was before, and the likelihood is full of walls. A descent on whole conditions that begins far away ends behind one of them; one that has
the beginnings right comes to the rest from nearby (as multiple shooting has it, Bock, Springer Ser. Chem. Phys. 18 (1981) 102).
"""

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from rfca_rig.diagnosis.data.dataset import THREADS
from rfca_rig.diagnosis.inference.map_fit import GaussNewton, MapFit, without_scatter
from rfca_rig.diagnosis.inference.parameterization import Parameterization

Floats = NDArray[np.float64]

BEGINNINGS = (0.3, 0.6, 0.8)  # shares to which conditions have grown
UNSEEN = 0.7  # prior deviations that are left open of what the data do not show
KEPT = 3  # fits that go on where conditions have grown to the second of these


@dataclass(frozen=True)
class _Place:
    """Where a descent begins."""

    coordinates: Parameterization
    x: Floats


def continue_from_beginnings(descent: GaussNewton, fits: Sequence[MapFit]) -> list[MapFit]:
    """The best of these anew, effects as they stand and nuisances as believed in the beginning, along growing conditions to the whole.

    None where no condition can be truncated, and none of a fit for which the model has no answer on the way.
    """
    if not fits:
        return []
    here = [_Place(fitted.coordinates, fitted.as_believed) for fitted in fits]
    for share in BEGINNINGS:
        beginnings = descent.evidence.truncated(share)
        if beginnings is None:
            return []
        step = without_scatter(beginnings)
        found = _each_descended(step, here)
        best = sorted(found, key=lambda pair: step.log_evidence(pair[1]), reverse=True)
        here = [_gone_on(step, place, fitted) for place, fitted in (best if share == BEGINNINGS[0] else best[:KEPT])]
    return [descent.converge(fitted) for _, fitted in _each_descended(descent, here)]


def _each_descended(step: GaussNewton, places: Sequence[_Place]) -> list[tuple[_Place, MapFit]]:
    """Those for which the model has an answer, each down from there."""
    begun = [(place, begin) for place in places if (begin := step.at(place.coordinates, place.x)) is not None]
    with ThreadPoolExecutor(THREADS) as pool:
        return list(zip([place for place, _ in begun], pool.map(step.refine, [begin for _, begin in begun]), strict=True))


def _gone_on(step: GaussNewton, place: _Place, fitted: MapFit) -> _Place:
    """Where it came to; what of its effects these beginnings do not show, as a stop not yet reached, stays where it was."""
    std = np.sqrt(np.diag(step.evaluate(fitted).posterior.covariance))
    unseen = (std > UNSEEN) & (np.arange(len(std)) >= fitted.coordinates.nuisances)
    return replace(place, x=np.where(unseen, place.x, fitted.x))
