"""Hypotheses that the recordings leave open, so that one more experiment can decide between them."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import softmax

from rfca_rig.diagnosis.config import IDENTIFIED_PROBABILITY
from rfca_rig.diagnosis.decision.decide import Decision
from rfca_rig.diagnosis.inference.hypotheses import Hypothesis, ModelSelectionResult

PLAUSIBLE = 0.01  # probability: a less probable hypothesis is not worth an experiment
MAX_HYPOTHESES = 5  # hypotheses: each costs as many simulations of every experiment as it has parameters
LEAST_WEIGHT = 0.05  # probability: the most probable hypothesis was not stated, so the others count at least this much


@dataclass(frozen=True)
class OpenHypotheses:
    """The open hypotheses of a search; at least two.

    Parameters
    ----------
    found
        The search.
    open
        The hypotheses, the accepted or most probable one first.
    probability
        (n,) their relative probabilities.
    """

    found: ModelSelectionResult
    open: tuple[Hypothesis, ...]
    probability: NDArray[np.float64]


def list_open_hypotheses(found: ModelSelectionResult, decision: Decision, enough: bool) -> OpenHypotheses | None:
    """Hypotheses that are open after a decision; None where there are fewer than two. Without `enough` conditions all are open."""
    best: dict[frozenset[str], Hypothesis] = {}  # variant of each set of effects
    for hypothesis in sorted((found.nothing, *found.named), key=lambda h: -h.log_joint):
        best.setdefault(frozenset(hypothesis.ids), hypothesis)
    ranked, accepted = list(best.values()), decision.explanation
    if not enough:
        is_open = ranked
    elif decision.grade == "identified":
        # After an identified effect, only the effects that explain the data as well are left to be excluded.
        rivals = {name for effect in decision.effects for name in effect.cannot_tell_from}
        is_open = [accepted, *(h for h in ranked if _swaps_one_effect(h, accepted, rivals))]
    elif decision.grade == "nothing missing" and decision.probability >= IDENTIFIED_PROBABILITY:
        is_open = []
    else:
        probability = softmax([h.log_joint for h in ranked])
        closest = (decision.closest or accepted).ids
        likely = [h for h, p in zip(ranked, probability, strict=True) if p >= PLAUSIBLE or h.ids == closest]
        # Nothing was stated, so at least the two most probable hypotheses are compared.
        is_open = likely if len(likely) > 1 else ranked[:2]
    if len(is_open) < 2:
        return None
    weight = np.maximum(softmax([h.log_joint for h in is_open[:MAX_HYPOTHESES]]), LEAST_WEIGHT)
    return OpenHypotheses(found, tuple(is_open[:MAX_HYPOTHESES]), weight / weight.sum())


def _swaps_one_effect(hypothesis: Hypothesis, accepted: Hypothesis, rivals: set[str]) -> bool:
    """Whether the hypothesis has one effect of the accepted one replaced by one of `rivals`, which explain the data as well."""
    new = set(hypothesis.ids) - set(accepted.ids)
    return len(hypothesis.ids) == len(accepted.ids) and len(new) == 1 and new <= rivals
