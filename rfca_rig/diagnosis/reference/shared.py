"""Effects that the model lacks in the reference, too.

Where a motion has no match in the reference, the model's error is not the same in both, and what
makes the model err in both looks like a change. Such an effect is known by the reference: it asks
for the effect there as well, at a size that explains what is different.
"""

import numpy as np
from numpy.typing import NDArray

from rfca_rig.diagnosis.config import AS_GOOD_LOG_ODDS, DOMINANT_SHARE
from rfca_rig.diagnosis.inference.hypotheses import Hypothesis
from rfca_rig.diagnosis.inference.parameterization import EffectTerm, Parameterization
from rfca_rig.diagnosis.reference.fit import ReferenceFit
from rfca_rig.diagnosis.simulator import Dataset
from rfca_rig.model.declarations.changes import VALUE_OF_CHANGE

Floats = NDArray[np.float64]


def find_shared_effects(
    explanation: Hypothesis, compared: Dataset, fit: ReferenceFit
) -> tuple[str, ...]:
    """The ids of those effects of an explanation that the reference asks for as well.

    Parameters
    ----------
    explanation
        What may have changed.
    compared
        The conditions of the recordings, compared with the reference.
    fit
        The reference.

    Returns
    -------
    tuple
        An effect is among them where it adds AS_GOOD_LOG_ODDS to the evidence of the reference, as
        the only effect there, and at the size that it has there does DOMINANT_SHARE of what it does
        in the recordings. A change of a nominal value is never among them, because the reference
        was fitted with that value free.
    """
    shared = []
    for number, term in enumerate(explanation.fitted.coordinates.choices):
        if term.effect.id in VALUE_OF_CHANGE:
            continue
        sizes = _fit_in_reference(term, explanation, number, fit)
        if sizes is None:
            continue
        if _measure_common_share(explanation, number, sizes, compared) >= DOMINANT_SHARE:
            shared.append(term.effect.id)
    return tuple(shared)


def _fit_in_reference(
    term: EffectTerm, explanation: Hypothesis, number: int, fit: ReferenceFit
) -> Floats | None:
    """Coordinates of the effect's sizes in the reference; None where the reference does not ask
    for it.
    """
    optimizer = fit.optimizer
    coordinates = Parameterization(fit.space, (term,))
    found = explanation.fitted
    begin = np.concatenate([fit.mean, found.x[found.coordinates.part(number)]])
    start = optimizer.at(coordinates, begin, fit.fitted.jacobian)
    if start is None:
        return None
    fitted = optimizer.refine(start)
    gain = optimizer.log_evidence(fitted) - optimizer.log_evidence(fit.fitted)
    if gain < AS_GOOD_LOG_ODDS:
        return None
    return np.asarray(fitted.x[coordinates.part(0)])


def _measure_common_share(
    explanation: Hypothesis, number: int, sizes: Floats, compared: Dataset
) -> float:
    """Share of what an effect does in the recordings that it does at other sizes, too: of the sum
    of squares in deviations; 0 where the model has no answer.
    """
    found = explanation.fitted
    coordinates = found.coordinates
    part = coordinates.part(number)
    others = [term for index, term in enumerate(coordinates.choices) if index != number]
    without = compared.predicted(
        coordinates.with_terms(others).supposed(np.delete(found.x, np.arange(found.x.size)[part]))
    )
    x = found.x.copy()
    x[part] = sizes
    as_in_reference = compared.predicted(coordinates.supposed(x))
    if without is None or as_in_reference is None:
        return 0.0
    whitening = explanation.marginal.whitening
    whole = whitening(found.predicted - without)
    missing = whitening(found.predicted - as_in_reference)
    return 1.0 - float(missing @ missing) / max(float(whole @ whole), 1e-300)
