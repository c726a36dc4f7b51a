"""Graded statements: what can be said where no law of the catalogue holds to the usual model error.

1. `mostly`: these one to three effects are the dominant omission. Each has a calibrated probability of at least STATED, and together they
   remove at least DOMINANT of the held-out misfit that can be removed.
2. `family`: only the family and its place can be told, with a calibrated probability of at least STATED.

Whether a law holds to the usual model error (`identified`) is decided in `decide`.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from rfca_rig.diagnosis.decision.calibration import calibration_of, support_values
from rfca_rig.diagnosis.decision.comparison import Comparison, ScaledHypothesis
from rfca_rig.diagnosis.decision.sizes import estimate_sizes
from rfca_rig.diagnosis.inference.hypotheses import Hypothesis
from rfca_rig.diagnosis.likelihood.laplace import laplace_posterior
from rfca_rig.diagnosis.likelihood.marginal_likelihood import MarginalPosterior
from rfca_rig.diagnosis.result import Grade, NamedEffect, StatedFamily
from rfca_rig.model.families import families_of

Floats = NDArray[np.float64]

STATED = 0.8  # calibrated probability from which a statement is made
DOMINANT = 0.3  # share of the removable held-out misfit: less is no dominant omission


@dataclass(frozen=True)
class Supported:
    """One effect, or family, with its calibrated probability and the numbers that this rests on."""

    kind: str
    id: str
    probability: float
    values: Mapping[str, float]


@dataclass(frozen=True)
class Statement:
    """What is stated: its grade, the explanation at its own discrepancy scale, and the share of the removable held-out misfit."""

    grade: Grade
    explanation: Hypothesis
    effects: tuple[NamedEffect, ...]
    family: StatedFamily | None
    probability: float
    explained_share: float


def support_of_best(comparison: Comparison) -> tuple[Supported, ...]:
    """The support of every effect of the best explanation, and of every family that one of them belongs to."""
    found = []
    for effect_id in comparison.best.ids:
        support = comparison.support((effect_id,))
        found.append(Supported("effect", effect_id, calibration_of("effect").probability(support), support_values(support)))
    families = {family.id: family for effect_id in comparison.best.ids for family in families_of(effect_id)}
    for family in families.values():
        support = comparison.support(tuple(sorted(family.members)))
        found.append(Supported("family", family.id, calibration_of("family").probability(support), support_values(support)))
    return tuple(found)


def state(comparison: Comparison, supported: Sequence[Supported]) -> Statement | None:
    """The strongest statement that the data support; None where they support none."""
    probability = {one.id: one.probability for one in supported if one.kind == "effect"}
    sure = [effect_id for effect_id in comparison.best.ids if probability[effect_id] >= STATED]
    explanation = _explanation(comparison, sure)
    if explanation is not None and comparison.explained_share(explanation) >= DOMINANT:
        hypothesis = at_own_scale(comparison, explanation)
        effects = tuple(
            describe_effect(comparison, hypothesis, number, probability[name], (), _words_of(comparison.law_error(explanation)))
            for number, name in enumerate(explanation.ids)
        )
        least = min(effect.probability for effect in effects)
        return Statement("mostly", hypothesis, effects, _best_family(comparison, supported), least, comparison.explained_share(explanation))
    family = _best_family(comparison, supported)
    if family is None or family.probability < STATED or comparison.explained_share(comparison.best) < DOMINANT:
        return None
    hypothesis = at_own_scale(comparison, comparison.best)
    return Statement("family", hypothesis, (), family, family.probability, comparison.explained_share(comparison.best))


def _explanation(comparison: Comparison, sure: Sequence[str]) -> ScaledHypothesis | None:
    """The most probable hypothesis with exactly these effects."""
    return next((one for one in comparison.ranked if sure and set(one.ids) == set(sure)), None)


def _best_family(comparison: Comparison, supported: Sequence[Supported]) -> StatedFamily | None:
    """The most probable family of the best explanation's effects; the larger one of two that are as probable, which says less."""
    known = {family.id: family for effect_id in comparison.best.ids for family in families_of(effect_id)}
    ranked = [(one.probability, len(known[one.id].members), one.id) for one in supported if one.kind == "family"]
    if not ranked:
        return None
    probability, _, name = max(ranked)
    family = known[name]
    return StatedFamily(name, family.words, family.place, probability, tuple(sorted(family.members)))


def at_own_scale(comparison: Comparison, one: ScaledHypothesis) -> Hypothesis:
    """The hypothesis with the posterior at its own most probable discrepancy scale."""
    hypothesis, measured = one.hypothesis, comparison.result.evidence.rows.measured
    posterior = laplace_posterior(hypothesis.fitted.linear(measured), one.whitening)
    judgement = MarginalPosterior(hypothesis.judgement.log_evidence, one.scale, posterior, one.whitening)
    return replace(hypothesis, judgement=judgement)


def _words_of(law_error: float) -> str:
    return f"the law is approximate: it is off by about {100.0 * law_error:.0f} % of what it explains"


def describe_effect(
    comparison: Comparison, hypothesis: Hypothesis, number: int, probability: float, others: tuple[str, ...], wording: str
) -> NamedEffect:
    """One effect of a hypothesis with its sizes; `others` are those that the data cannot tell it from."""
    effect = hypothesis.fitted.coordinates.choices[number].effect
    parameters, shape = estimate_sizes(comparison, hypothesis, number)
    return NamedEffect(
        id=effect.id,
        left_out=effect.left_out,
        probability=min(probability, 0.999),
        parameters=parameters,
        shape=shape,
        cannot_tell_from=others,
        wording=wording,
    )
