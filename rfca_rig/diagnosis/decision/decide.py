"""What can be stated, and how surely, from the hypotheses of a search."""

from collections.abc import Sequence
from dataclasses import replace

from rfca_rig.diagnosis.config import (
    IDENTIFIED_PROBABILITY,
    LAW_ERROR,
    NOTHING_PROBABILITY,
    STATED_PROBABILITY,
)
from rfca_rig.diagnosis.decision.comparison import Comparison, ScaledHypothesis, compare
from rfca_rig.diagnosis.decision.criteria import (
    describe_relief,
    is_dominant,
    is_worse,
    list_criteria,
)
from rfca_rig.diagnosis.decision.decision import Decision, Supported
from rfca_rig.diagnosis.decision.families import (
    find_best_family,
    find_other_families,
    name_families,
    support_of_best,
)
from rfca_rig.diagnosis.decision.sizes import estimate_sizes, widen
from rfca_rig.diagnosis.decision.table import (
    UNKNOWN,
    list_alternatives,
    probability_of,
    rank_rivals,
)
from rfca_rig.diagnosis.inference.hypotheses import Hypothesis, ModelSelectionResult
from rfca_rig.diagnosis.likelihood.marginal_likelihood import MarginalPosterior, laplace_posterior
from rfca_rig.diagnosis.result import NamedEffect, Value
from rfca_rig.model.catalogue import list_related

NOT_AS_A_WHOLE = (
    "the set that it belongs to does not remove most of what is missing, or predicts something "
    "worse"
)
NOT_BETTER = "left-out conditions are not predicted better with it"


def decide(found: ModelSelectionResult) -> Decision:
    """Decide what can be stated, and how surely.

    Parameters
    ----------
    found
        The result of the search.
    """
    comparison = compare(found)
    decision = decide_from(comparison, support_of_best(comparison))
    # An effect that was not tried may explain as much as the best that was.
    if not found.tried_each_effect:
        return replace(withhold(decision, found), is_unfinished=True)
    return decision


def decide_from(comparison: Comparison, supported: Sequence[Supported]) -> Decision:
    """The decision from the compared hypotheses and the support of the effects and families of
    the best explanation.
    """
    result = comparison.result
    rivals = rank_rivals(comparison)
    of_effects = {effect.id: effect for effect in supported if effect.kind == "effect"}
    is_usual = all(criterion.passed for criterion in list_criteria(comparison.nothing, ()))
    # Where the model without effects predicts as models usually do, its error may look like an
    # effect.
    if is_usual:
        needed = IDENTIFIED_PROBABILITY
    else:
        needed = STATED_PROBABILITY
    unsure = comparison.find_unsure_laws()
    nothing = probability_of((), rivals)
    # What the table of all sets denies is not stated, however well held-out conditions are
    # predicted with it.
    is_denied = nothing > NOTHING_PROBABILITY
    objections = {
        effect.id: _object_to(effect, needed, effect.id in unsure, is_denied)
        for effect in of_effects.values()
    }
    # The first set of the table may not be the best explanation.
    for effect_id in rivals[0].ids:
        if rivals[0].ids != UNKNOWN:
            objections.setdefault(effect_id, NOT_BETTER)
    sure = {effect_id for effect_id, objection in objections.items() if not objection}
    # The stated set must have been fitted as a whole; otherwise nothing is known of its held-out
    # misfit.
    explanation = next(
        (candidate for candidate in comparison.ranked if sure and set(candidate.ids) == sure), None
    )
    best = at_own_scale(comparison.best)
    family = find_best_family(comparison, supported, comparison.best.ids)
    is_family = (
        family is not None
        and not is_denied
        and family.probability >= needed
        and is_dominant(comparison, comparison.best)
    )
    judged = explanation or comparison.best
    criteria = list_criteria(judged, [of_effects[name] for name in judged.ids])
    is_exact = all(criterion.passed for criterion in criteria)
    decision = Decision(
        "unexplained",
        result.nothing,
        best if best.ids else None,
        criteria=criteria,
        rivals=rivals,
        supported=tuple(supported),
        within_usual=is_usual,
        not_stated={name: why or NOT_AS_A_WHOLE for name, why in objections.items()},
    )
    # A set that leaves much misfit may still be the dominant omission: then it is stated as
    # "mostly".
    if (
        explanation is not None
        and (is_exact or is_dominant(comparison, explanation))
        and not is_worse(comparison, explanation)
    ):
        hypothesis = at_own_scale(explanation)
        effects = tuple(
            _describe_effect(comparison, explanation, effect_id, of_effects[effect_id])
            for effect_id in explanation.ids
        )
        known = sure.union(*(effect.cannot_tell_from for effect in effects))
        stated = replace(
            decision,
            grade="identified" if is_exact else "mostly",
            explanation=hypothesis,
            closest=None if explanation is comparison.best else best,
            effects=effects,
            not_stated={name: why for name, why in objections.items() if name not in known},
            family=family if is_family else None,
            other_families=find_other_families(
                comparison, supported, list_related(explanation.ids)
            ),
            probability=min(effect.probability for effect in effects),
            explained_share=comparison.explained_share(explanation),
            relieved_strain=describe_relief(comparison, explanation),
        )
        return name_families(comparison, supported, stated)
    if family is not None and is_family and not comparison.predicts_worse(comparison.best):
        return replace(
            decision,
            grade="family",
            explanation=best,
            family=family,
            other_families=find_other_families(comparison, supported, family.members),
            probability=family.probability,
            explained_share=comparison.explained_share(comparison.best),
            relieved_strain=describe_relief(comparison, comparison.best),
        )
    if is_usual and is_denied:
        return replace(decision, grade="nothing missing", probability=nothing)
    return replace(decision, probability=1.0 - nothing, alternatives=list_alternatives(rivals))


def _object_to(effect: Supported, needed: float, is_unsure: bool, is_denied: bool) -> str:
    """Why an effect of the best explanation is not stated, in words; "" where it may be."""
    if is_denied:
        return "the table of all sets gives nothing missing more than one half"
    if effect.probability < needed:
        return f"its calibrated probability is {effect.probability:.2f}, and {needed:g} is needed"
    if effect.is_at_bound:
        return "its size is at the end of its plausible range, where another law looks like this"
    if not effect.is_needed:
        return (
            "without it the other laws leave no more than approximate laws usually do, so that it "
            "may only make up for their error"
        )
    if is_unsure:
        return "fewer laws of its family explain these data nearly as well"
    return ""


def withhold(decision: Decision, found: ModelSelectionResult) -> Decision:
    """The decision without what it states, which stays the closest explanation."""
    nothing = probability_of((), decision.rivals)
    return replace(
        decision,
        grade="unexplained",
        explanation=found.nothing,
        closest=decision.explanation if decision.explanation.ids else decision.closest,
        effects=(),
        family=None,
        other_families=(),
        probability=1.0 - nothing,
        explained_share=1.0,
        relieved_strain="",
        alternatives=list_alternatives(decision.rivals),
    )


def at_own_scale(one: ScaledHypothesis) -> Hypothesis:
    """The hypothesis with the posterior at its own most probable discrepancy scale, the usual one
    at least.

    A fit that happens to be better than usual is no reason for narrower intervals.
    """
    linear = one.hypothesis.fitted.linear(one.result.dataset.rows.measured)
    whitening = one.result.likelihood.level(linear)
    marginal = MarginalPosterior(
        one.hypothesis.marginal.log_evidence,
        one.scale,
        laplace_posterior(linear, whitening),
        whitening,
    )
    return replace(one.hypothesis, marginal=marginal)


def _describe_effect(
    comparison: Comparison, hypothesis: ScaledHypothesis, effect_id: str, supported: Supported
) -> NamedEffect:
    """One stated effect with its sizes, and the effects that the data do not distinguish from
    it.
    """
    whole = comparison.whole_set(hypothesis.ids)
    effect = whole.hypothesis.fitted.coordinates.choices[whole.ids.index(effect_id)].effect
    parameters, shape = estimate_stated_sizes(comparison, whole, effect_id)
    law_error = comparison.law_error(hypothesis)
    off = f"the law is off by about {100.0 * law_error:.0f} % of what it explains"
    # Effects of the same family that could take its place, and whose law error is usual, or no
    # larger than its own.
    kept = set(hypothesis.ids) - {effect_id}
    most = max(LAW_ERROR, comparison.law_error(hypothesis))
    swapped = [
        rival
        for rival in comparison.ranked
        if len(rival.ids) == len(hypothesis.ids) and kept <= set(rival.ids)
    ]
    others = {
        other
        for rival in swapped
        if comparison.law_error(rival) <= most
        for other in set(rival.ids) - set(hypothesis.ids)
    }
    return NamedEffect(
        id=effect_id,
        left_out=effect.left_out,
        # The calibration rests on some dozens of statements, so more digits would claim too much.
        probability=min(supported.probability, 0.999),
        parameters=parameters,
        shape=shape,
        cannot_tell_from=tuple(
            sorted(
                {
                    *supported.cannot_tell_from,
                    *comparison.equals_of(hypothesis, effect_id),
                    *(others & list_related((effect_id,))),
                }
            )
        ),
        # The only body of a model is no range.
        plausible={
            parameter.name: (parameter.low, parameter.high)
            for parameter in effect.parameters
            if parameter.low < parameter.high
        },
        wording=off if law_error < 1.0 else "these data do not tell how well the law holds",
    )


def estimate_stated_sizes(
    comparison: Comparison, whole: ScaledHypothesis, effect_id: str
) -> tuple[dict[str, Value], dict[str, Value]]:
    """Parameters and shape parameters of a stated effect, from the best whole set, widened over the
    sets that predict as well.

    Without its partners an effect takes up what they do, and its size is off by that.
    """
    sizes = [
        _sizes_in(comparison, hypothesis, effect_id)
        for hypothesis in (whole, *comparison.sets_as_good_as(whole, effect_id))
    ]
    return widen(sizes, 0), widen(sizes, 1)


def _sizes_in(
    comparison: Comparison, hypothesis: ScaledHypothesis, effect_id: str
) -> tuple[dict[str, Value], dict[str, Value]]:
    return estimate_sizes(comparison, at_own_scale(hypothesis), hypothesis.ids.index(effect_id))
