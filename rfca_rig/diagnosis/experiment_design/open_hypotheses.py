"""Which hypotheses the recordings leave open, so that one more experiment has something to decide."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import softmax

from rfca_rig.diagnosis.config import SURE
from rfca_rig.diagnosis.decision.decide import Decision
from rfca_rig.diagnosis.inference.hypotheses import Hypothesis, ModelSelectionResult

Floats = NDArray[np.float64]

PLAUSIBLE = 0.01  # a hypothesis less probable than this is not worth an experiment
MOST = 5
HEARD = 0.05  # every one that is left open counts this much at least: the likeliest was not stated


@dataclass(frozen=True)
class OpenHypotheses:
    """Hypotheses about one body of evidence that are still open, likeliest first, with probabilities (n,) among themselves."""

    found: ModelSelectionResult
    open: tuple[Hypothesis, ...]
    probability: Floats


def contest_of(found: ModelSelectionResult, decision: Decision, enough: bool) -> OpenHypotheses | None:
    """What is open after a decision; None where all is said. Without `enough` conditions everything stays open."""
    if not enough:
        return _contest(found, _ranked((found.nothing, *found.named))[:MOST])
    if decision.grade == "identified":
        return _contest(found, _same_class(found, decision))
    if decision.grade == "nothing missing" and decision.probability >= SURE:
        return None
    return _contest(found, _plausible(found, decision))


def name_of(ids: Sequence[str]) -> str:
    """A hypothesis in words."""
    return " with ".join(ids) or "nothing missing"


def _contest(found: ModelSelectionResult, hypotheses: Sequence[Hypothesis]) -> OpenHypotheses | None:
    if not hypotheses:
        return None
    weights = np.maximum(softmax([h.log_joint for h in hypotheses]), HEARD)
    return OpenHypotheses(found, tuple(hypotheses), np.asarray(weights / weights.sum(), dtype=np.float64))


def _ranked(hypotheses: Iterable[Hypothesis]) -> list[Hypothesis]:
    """The best variant of each set of effects, most probable first."""
    best: dict[tuple[str, ...], Hypothesis] = {}
    for hypothesis in sorted(hypotheses, key=lambda h: -h.log_joint):
        best.setdefault(tuple(sorted(hypothesis.ids)), hypothesis)
    return list(best.values())


def _same_class(found: ModelSelectionResult, decision: Decision) -> list[Hypothesis]:
    """The accepted one, and those in which one effect stands for another that explains the data as well."""
    accepted = decision.explanation
    others = {name for effect in decision.effects for name in effect.cannot_tell_from}
    if not others:
        return []
    ranked = _ranked(found.named)
    rest = [h for h in ranked if len(h.ids) == len(accepted.ids) and len(new := set(h.ids) - set(accepted.ids)) == 1 and new <= others]
    return [accepted, *rest][:MOST]


def _plausible(found: ModelSelectionResult, decision: Decision) -> list[Hypothesis]:
    """The likely ones and the closest; where that is one alone, the next best as well."""
    ranked = _ranked((found.nothing, *found.named))
    probability = softmax([h.log_joint for h in ranked])
    closest = decision.closest.ids if decision.closest else decision.explanation.ids
    kept = [h for h, p in zip(ranked, probability, strict=True) if p >= PLAUSIBLE or h.ids == closest]
    return (kept if len(kept) > 1 else ranked[:2])[:MOST]
