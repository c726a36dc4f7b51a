"""What a strained nuisance does, handed over to an effect that does the same.

A soft floor and a contact softer than believed push alike; along such a ridge only the prior says where to stand, and its slope is lost in
the roughness of a model with touchdowns in it. A descent that came from the nuisance's side stays there.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from rfca_rig.diagnosis.covariance import Whitening
from rfca_rig.diagnosis.descent import Descent, Fitted

Floats = NDArray[np.float64]

STRAINED = 2.5  # deviations from where a nuisance is believed
COARSE = tuple(np.linspace(-2.0, 2.0, 9))  # sizes of an effect's coordinate,
FINE = tuple(np.linspace(-0.4, 0.4, 9))  # and steps from the best of them
AT_MOST = 2  # nuisances, one after the other


def handed_over(descent: Descent, found: Fitted) -> Fitted:
    """The better of `found` and of where its effects lead when its most strained nuisance begins as believed."""
    for _ in range(AT_MOST):
        worst = int(np.argmax(np.abs(found.x[: found.coordinates.nuisances])))
        begin = _begun(descent, found, worst) if abs(found.x[worst]) > STRAINED else None
        if begin is None:
            return found
        again = descent.polished(descent.descended(begin))
        if descent.judged(again).log_evidence <= descent.judged(found).log_evidence:
            return found
        found = again
    return found


def _begun(descent: Descent, found: Fitted, worst: int) -> Fitted | None:
    """The nuisance as believed, and the effects as large as then fits best; None without an effect, or where the model has no answer."""
    begin = found.x.copy()
    begin[worst] = 0.0
    whitening = descent.judge.level(found.linear(descent.evidence.rows.measured))
    free = range(found.coordinates.nuisances, len(begin))
    best = _best_of(descent, found, whitening, [_with(begin, place, size) for place in free for size in COARSE])
    if best is not None:
        best = _best_of(descent, found, whitening, [_with(best, place, best[place] + size) for place in free for size in FINE])
    return None if best is None else descent.at(found.coordinates, best)


def _best_of(descent: Descent, found: Fitted, whitening: Whitening, places: Sequence[Floats]) -> Floats | None:
    predicted = descent.evidence.predicted_all([found.coordinates.supposed(x) for x in places])
    with_answer = [(x, rows) for x, rows in zip(places, predicted, strict=True) if rows is not None]
    best = min(with_answer, key=lambda pair: descent.misfit(pair[0], pair[1], whitening), default=None)
    return None if best is None else best[0]


def _with(x: Floats, place: int, size: float) -> Floats:
    there = x.copy()
    there[place] = size
    return there
