"""Sizes of stated effects, with intervals that include the remaining misfit.

The standard deviation of a parameter has two independent parts:

1. The data: the larger one of two estimates. One is the posterior at the discrepancy scale of the hypothesis. The other is a delete-one
   jackknife over conditions (Quenouille, Biometrika 43 (1956) 353), which is robust to errors that the observations of one condition share.
2. The law itself: a real cause departs from its law in the catalogue by LAW_SIZE_ERROR at least. Where held-out misfit remains, it
   departs by up to the share of that misfit in what the effect removes.
"""

import numpy as np
from numpy.typing import NDArray

from rfca_rig.diagnosis.config import LAW_MISFIT_SHARE, LAW_SHAPE_ERROR, LAW_SIZE_ERROR
from rfca_rig.diagnosis.decision.comparison import Comparison
from rfca_rig.diagnosis.decision.detection_limits import size_parameter, without_effect
from rfca_rig.diagnosis.inference.hypotheses import Hypothesis
from rfca_rig.diagnosis.inference.parameterization import EffectTerm, std_of, value_of
from rfca_rig.diagnosis.likelihood.cross_validation import jackknife_std
from rfca_rig.diagnosis.result import Value
from rfca_rig.model.effect import Parameter

Floats = NDArray[np.float64]


def estimate_sizes(comparison: Comparison, hypothesis: Hypothesis, number: int) -> tuple[dict[str, Value], dict[str, Value]]:
    """Values and standard deviations of one effect of a hypothesis: its parameters, and the shape parameters of its law.

    Parameters
    ----------
    comparison
        The comparison that the hypothesis is part of.
    hypothesis
        The hypothesis with the posterior at the scale that its values are stated at.
    number
        Which of its effects.
    """
    term = hypothesis.fitted.coordinates.choices[number]
    part, posterior = hypothesis.fitted.coordinates.part(number), hypothesis.marginal.posterior
    std = np.maximum(np.sqrt(np.diag(posterior.covariance))[part], _jackknife_std(comparison, hypothesis)[part])
    law = LAW_MISFIT_SHARE * comparison.law_error(comparison.scaled(hypothesis))
    parameters: dict[str, Value] = {name: Value(value, 0.0) for name, value in term.whole}
    shape: dict[str, Value] = {}
    for parameter, z, std_z in zip(term.free, posterior.mean[part].tolist(), std.tolist(), strict=True):
        value = value_of(parameter, z)
        of_law = _law_uncertainty(term, parameter, value, law, hypothesis)
        found = Value(value, float(np.hypot(std_of(parameter, z, std_z), of_law)))
        if parameter in term.sizes:
            parameters[parameter.name] = found
        elif parameter in term.effect.shape:
            shape[parameter.name] = found
    return parameters, shape


def _law_uncertainty(term: EffectTerm, parameter: Parameter, value: float, law: float, hypothesis: Hypothesis) -> float:
    """Standard deviation of a value because the law is only approximate.

    A size is counted from where the effect does nothing. Both gains of the control loop of a drive are sizes.
    """
    if term.effect.where == "drive":
        return max(LAW_SIZE_ERROR, law) * abs(value)
    if parameter == size_parameter(term.effect):
        return max(LAW_SIZE_ERROR, law) * abs(value - without_effect(term.effect, hypothesis.fitted.coordinates.space.centre.rig))
    return max(LAW_SHAPE_ERROR, law) * abs(value) if parameter in term.sizes else 0.0


def _jackknife_std(comparison: Comparison, hypothesis: Hypothesis) -> Floats:
    """Standard deviations (p,) of all unknowns by leaving one condition out at a time."""
    rows = comparison.result.dataset.rows
    return jackknife_std(hypothesis.fitted.linear(rows.measured), hypothesis.marginal.whitening, rows.condition)
