"""From compared hypotheses to a graded answer.

1. `compare` integrates the discrepancy scale out of every hypothesis; the best explanation is the
   most probable one whose effects all improve held-out conditions.
2. Each of its effects, with those that explain the data as well, and each of their families gets a
   calibrated probability.
3. The grade follows from three numbers: these probabilities, the held-out misfit of the explanation
   in units of noise and usual model error, and the distance of its nuisance parameters from their
   priors.

`identified`
    every effect has a probability of IDENTIFIED_PROBABILITY, the held-out misfit is as small as
    models usually leave, and no nuisance parameter is implausible
`mostly`
    every stated effect has a probability of STATED_PROBABILITY, and together they remove
    DOMINANT_SHARE of what can be removed of the held-out misfit, or a nuisance parameter is
    implausible without them; none merely compensates for the error of another law; nothing is
    predicted worse, in sum or in a quantity
`family`
    one family has a probability of STATED_PROBABILITY, and the best explanation removes as much;
    nothing is predicted worse in sum
`nothing missing`
    nothing is stated, the model without effects predicts all held-out conditions as well as models
    usually do, and in the table of all sets nothing is more probable than everything else together
`unexplained`
    otherwise: something is missing, or there is a difference that is visible but within the usual
    model error, or nothing is more probable than all sets though the difference is larger

Nothing is stated where the table of all sets gives "nothing missing" more than one half.
"""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from scipy.special import logsumexp

from rfca_rig.diagnosis.config import (
    DOMINANT_SHARE,
    IDENTIFIED_PROBABILITY,
    IMPLAUSIBLE,
    LAW_ERROR,
    MAX_COORDINATE,
    MOST_RIVALS,
    NOTHING_PROBABILITY,
    PRIOR_UNKNOWN,
    STATED_PROBABILITY,
    USUAL_MISFIT,
    VISIBLE_PROBABILITY,
    WORTH_ADDING,
)
from rfca_rig.diagnosis.decision.calibration import Kind, calibration_of, support_values
from rfca_rig.diagnosis.decision.comparison import Comparison, ScaledHypothesis, compare
from rfca_rig.diagnosis.decision.sizes import estimate_sizes, widen
from rfca_rig.diagnosis.inference.hypotheses import Hypothesis, ModelSelectionResult
from rfca_rig.diagnosis.likelihood.marginal_likelihood import MarginalPosterior, laplace_posterior
from rfca_rig.diagnosis.result import (
    Criterion,
    Grade,
    NamedEffect,
    Rival,
    StatedFamily,
    Value,
    Verdict,
)
from rfca_rig.model.catalogue import families_of, list_related, members_of
from rfca_rig.model.declarations.changes import VALUE_OF_CHANGE
from rfca_rig.model.families import Family

UNKNOWN = ("unknown",)
# Grades with effects or a family.
STATED_GRADES = ("identified", "mostly", "family")
# sets that are named beside a difference that is visible within the usual model error
MOST_ALTERNATIVES = 5
HELD_OUT = "held-out misfit"
PLAUSIBLE = "plausible values"
NOT_AS_A_WHOLE = (
    "the set that it belongs to does not remove most of what is missing, or predicts something "
    "worse"
)
NOT_BETTER = "left-out conditions are not predicted better with it"
AS_ITS_FAMILY = "the data tell it from no other law of its family, which is stated in its place"
PROBABLE = "probability"
# Laws that look alike and are called by the name of their family; fewer are named.
FEWEST_ALIKE = 3


@dataclass(frozen=True)
class Supported:
    """One effect, or family, with its calibrated probability and the values that this rests on.

    Parameters
    ----------
    kind, id
        Whether it is an effect or a family, and which one.
    probability
        Calibrated probability.
    values
        Its support as plain numbers.
    cannot_tell_from
        Effects that explain the data as well.
    is_variation
        Whether another effect of the best explanation belongs to one of its families, so that it
        may only make up for that one's law.
    is_at_bound
        Whether the fit has one of its sizes at the end of its plausible range. Another law looks so
        through this one.
    """

    kind: Kind
    id: str
    probability: float
    values: Mapping[str, float]
    cannot_tell_from: tuple[str, ...] = ()
    is_variation: bool = False
    is_at_bound: bool = False

    @property
    def is_needed(self) -> bool:
        """Whether the laws of the other effects leave more than approximate laws usually do, or
        almost nothing remains with it.

        A variation of another law always removes most of what that law leaves, so that only the
        first counts for it.
        """
        is_small = self.values["law_error_without"] <= LAW_ERROR
        return not is_small or (
            self.values["removed_share"] > 1.0 - WORTH_ADDING and not self.is_variation
        )


@dataclass(frozen=True)
class Decision:
    """The graded answer about one set of observations.

    Parameters
    ----------
    grade
        What is stated.
    explanation
        The hypothesis behind the statement, with the posterior at its own discrepancy scale. It is
        the one without effects where nothing is stated.
    closest
        The best explanation where it is not stated as a whole; None where no hypothesis beats the
        one without effects.
    effects, family
        What is stated. A family is given beside effects, too.
    not_stated
        Each effect of the best explanation, and of the first set of the table, that is not stated,
        and why.
    other_families
        Families, as probable as an identified effect, of those effects of the best explanation that
        are neither stated nor in `family`.
    probability
        Probability of the statement: the least of its effects, or that of the family. For other
        grades, that something is, or is not, missing.
    explained_share
        Share of the removable held-out misfit that the explanation removes.
    relieved_strain
        The implausible nuisance parameters whose place the explanation takes, in words; empty where
        its share supports it.
    criteria
        What `identified` requires, with what was found.
    rivals
        All hypotheses with their relative probabilities, most probable first.
    supported
        The effects and families of the best explanation.
    alternatives
        Where nothing is stated and something is missing or visible: the sets of effects that may be
        behind it.
    within_usual
        Whether the model without effects predicts as models usually do.
    is_unfinished
        Whether the time was up before every effect was tried.
    """

    grade: Grade
    explanation: Hypothesis
    closest: Hypothesis | None = None
    effects: tuple[NamedEffect, ...] = ()
    not_stated: Mapping[str, str] = field(default_factory=dict)
    family: StatedFamily | None = None
    other_families: tuple[StatedFamily, ...] = ()
    probability: float = 1.0
    explained_share: float = 1.0
    relieved_strain: str = ""
    criteria: tuple[Criterion, ...] = ()
    rivals: tuple[Rival, ...] = ()
    supported: tuple[Supported, ...] = ()
    alternatives: tuple[Rival, ...] = ()
    within_usual: bool = False
    is_unfinished: bool = False

    @property
    def verdict(self) -> Verdict:
        """The grade in the words of rfca-diagnosis/1."""
        if self.grade == "identified":
            return "named"
        # Two comparisons, since they narrow the type.
        if self.grade == "mostly" or self.grade == "family":  # noqa: PLR1714
            return "unexplained"
        return self.grade

    @property
    def suspects(self) -> frozenset[str]:
        """Effects that no detection limit may exclude.

        These are the effects that are stated or closest, every one that is not surely absent or
        part of a set that is not, and all that the data hardly distinguish from them: their
        families.
        """
        possible = {
            effect.id
            for effect in self.supported
            if effect.kind == "effect" and effect.probability > 1.0 - IDENTIFIED_PROBABILITY
        }
        in_table = {
            effect_id
            for rival in self.rivals
            if rival.probability > VISIBLE_PROBABILITY
            for effect_id in rival.ids
        }
        stated = {
            *self.explanation.ids,
            *(other for effect in self.effects for other in effect.cannot_tell_from),
        }
        closest = () if self.closest is None else self.closest.ids
        return list_related({*possible, *(in_table - set(UNKNOWN)), *stated, *closest})

    @property
    def predicts_as_usual(self) -> bool:
        """Whether the explanation predicts held-out conditions as models usually do, with plausible
        values.

        Otherwise what remains may hide an effect.
        """
        if not self.explanation.ids:
            return self.within_usual
        return all(criterion.passed for criterion in self.criteria if criterion.name != PROBABLE)

    @property
    def fits_poorly(self) -> bool:
        """Whether the best explanation neither predicts as models usually do nor has plausible
        values.
        """
        failed = {criterion.name for criterion in self.criteria if not criterion.passed}
        return failed.issuperset((HELD_OUT, PLAUSIBLE))

    def list_rivals(self, most: int) -> tuple[Rival, ...]:
        """The first rows of the table of sets, with those of nothing and of the stated set
        wherever they stand.
        """
        always = ((), tuple(sorted(effect.id for effect in self.effects)))
        return tuple(
            rival
            for number, rival in enumerate(self.rivals)
            if number < most or tuple(sorted(rival.ids)) in always
        )


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
    is_usual = all(criterion.passed for criterion in _criteria(comparison.nothing, ()))
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
    family = _best_family(comparison, supported, comparison.best.ids)
    is_family = (
        family is not None
        and not is_denied
        and family.probability >= needed
        and _is_dominant(comparison, comparison.best)
    )
    judged = explanation or comparison.best
    criteria = _criteria(judged, [of_effects[name] for name in judged.ids])
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
        and (is_exact or _is_dominant(comparison, explanation))
        and not _is_worse(comparison, explanation)
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
            other_families=_other_families(comparison, supported, list_related(explanation.ids)),
            probability=min(effect.probability for effect in effects),
            explained_share=comparison.explained_share(explanation),
            relieved_strain=_describe_relief(comparison, explanation),
        )
        return _name_families(comparison, supported, stated)
    if family is not None and is_family and not comparison.predicts_worse(comparison.best):
        return replace(
            decision,
            grade="family",
            explanation=best,
            family=family,
            other_families=_other_families(comparison, supported, family.members),
            probability=family.probability,
            explained_share=comparison.explained_share(comparison.best),
            relieved_strain=_describe_relief(comparison, comparison.best),
        )
    if is_usual and is_denied:
        return replace(decision, grade="nothing missing", probability=nothing)
    return replace(decision, probability=1.0 - nothing, alternatives=list_alternatives(rivals))


def _name_families(
    comparison: Comparison, supported: Sequence[Supported], decision: Decision
) -> Decision:
    """The decision with families in place of those effects that the data tell from no other law of
    their family.
    """
    families: dict[str, StatedFamily] = {}
    for effect in decision.effects:
        family = _find_family_alike(comparison, supported, effect)
        beside = {other.id for other in decision.effects} - {effect.id}
        if family is not None and beside.isdisjoint(family.members):
            families[effect.id] = family
    if not families:
        return decision
    named = tuple(effect for effect in decision.effects if effect.id not in families)
    not_stated = {**decision.not_stated, **dict.fromkeys(families, AS_ITS_FAMILY)}
    other_families = tuple(dict.fromkeys((*families.values(), *decision.other_families)))
    if named:
        return replace(
            decision,
            effects=named,
            family=_best_family(comparison, supported, [effect.id for effect in named])
            if decision.family
            else None,
            other_families=other_families,
            probability=min(effect.probability for effect in named),
            not_stated=not_stated,
        )
    return replace(
        decision,
        grade="family",
        effects=(),
        family=other_families[0],
        other_families=other_families[1:],
        probability=other_families[0].probability,
        not_stated=not_stated,
    )


def _find_family_alike(
    comparison: Comparison, supported: Sequence[Supported], effect: NamedEffect
) -> StatedFamily | None:
    """The smallest family of which the data tell an effect from no other law that was tried in its
    place, if it is sure.

    Two laws that look alike are both named; FEWEST_ALIKE are called by the name of their family.
    """
    tried = _list_tried(comparison)
    alike = {effect.id, *effect.cannot_tell_from}
    laws_alike = comparison.laws_of(alike & tried)
    if len(laws_alike) < FEWEST_ALIKE:
        return None
    # A variant that is told apart, as a law in one joint alone, says nothing against the law.
    told_apart = comparison.laws_of(comparison.tells_from(effect.id)) - laws_alike
    probabilities = {support.id: support.probability for support in supported}
    for family in sorted(_families_of_best(comparison).values(), key=_count_members):
        members = members_of(family.id)
        is_whole = alike <= members and told_apart.isdisjoint(members)
        if is_whole and probabilities[family.id] >= IDENTIFIED_PROBABILITY:
            return _state_family(comparison, family, probabilities[family.id])
    return None


def _count_members(family: Family) -> int:
    return len(members_of(family.id))


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


def probability_of(ids: Sequence[str], rivals: Sequence[Rival]) -> float:
    """Probability of a set of effects in the table; 0 where it is not listed."""
    return next((rival.probability for rival in rivals if rival.ids == tuple(ids)), 0.0)


def list_alternatives(rivals: Sequence[Rival]) -> tuple[Rival, ...]:
    """The sets of effects of a table that share nearly all of the probability that something is
    missing, most probable first.
    """
    with_effects = [rival for rival in rivals if rival.ids not in ((), UNKNOWN)]
    total = sum(rival.probability for rival in with_effects)
    alternatives: list[Rival] = []
    for rival in with_effects:
        if (
            sum(alternative.probability for alternative in alternatives)
            >= (1.0 - VISIBLE_PROBABILITY) * total
        ):
            break
        alternatives.append(rival)
    return tuple(alternatives[:MOST_ALTERNATIVES])


def _describe_relief(comparison: Comparison, hypothesis: ScaledHypothesis) -> str:
    """Implausible nuisance parameters, in words, that a hypothesis replaces; empty where there are
    none, or it explains DOMINANT_SHARE.

    The model without effects needs them to predict what it does, and the hypothesis, which needs
    none, predicts as usual or as well, in no quantity worse. All nuisance parameters together move
    closer to their priors by as much as a value at the limit is away.
    """
    if comparison.explained_share(hypothesis) >= DOMINANT_SHARE or describe_strain(hypothesis):
        return ""
    # A value that moves from just beyond the limit to just within it is not replaced.
    relieved = comparison.nothing.sum_of_squared_shifts - hypothesis.sum_of_squared_shifts
    if relieved < IMPLAUSIBLE**2:
        return ""
    if hypothesis.misfit_of_all > max(USUAL_MISFIT, comparison.nothing.misfit_of_all):
        return ""
    if comparison.predicts_a_quantity_worse(hypothesis):
        return ""
    return describe_strain(comparison.nothing)


def _is_dominant(comparison: Comparison, hypothesis: ScaledHypothesis) -> bool:
    """Whether a hypothesis explains most of what is missing, or replaces an implausible value
    that explains all of it.
    """
    return comparison.explained_share(hypothesis) >= DOMINANT_SHARE or bool(
        _describe_relief(comparison, hypothesis)
    )


def _is_worse(comparison: Comparison, hypothesis: ScaledHypothesis) -> bool:
    """Whether a hypothesis predicts held-out conditions worse than the model without effects, in
    sum or in a quantity.

    A quantity that is predicted worse shows that the law is wrong, which says nothing against its
    family.
    """
    return comparison.predicts_worse(hypothesis) or comparison.predicts_a_quantity_worse(hypothesis)


def support_of_best(comparison: Comparison) -> tuple[Supported, ...]:
    """Support of every effect of the best explanation, and of every family of one of them.

    The rival of an effect has none of the effects that are as good, no variant of it, and no law
    that its own law turns into: they would predict the same. A family is at least as probable as an
    effect whose indistinguishable set lies within it, because the effect implies the family.
    """
    supported: list[Supported] = []
    for effect_id in comparison.best.ids:
        alike = comparison.as_good_as(effect_id)
        equal = comparison.equals_of(comparison.best, effect_id)
        values = support_values(
            comparison.support((effect_id, *alike, *comparison.variants_of(effect_id), *equal))
        )
        is_variation = not list_related((effect_id,)).isdisjoint(
            set(comparison.best.ids) - {effect_id}
        )
        probability = calibration_of("effect").probability(values)
        at_bound = comparison.is_at_bound(effect_id)
        supported.append(
            Supported("effect", effect_id, probability, values, alike, is_variation, at_bound)
        )
    for family in _families_of_best(comparison).values():
        members = members_of(family.id)
        values = support_values(comparison.support(tuple(sorted(members))))
        within = [
            support.probability
            for support in supported
            if members.issuperset((support.id, *support.cannot_tell_from))
        ]
        supported.append(
            Supported(
                "family",
                family.id,
                max((calibration_of("family").probability(values), *within)),
                values,
            )
        )
    return tuple(supported)


def _families_of_best(comparison: Comparison) -> dict[str, Family]:
    """Families of the effects of the best explanation, by id.

    A family of which less than a third of the members were tried belongs to another kind of rig.
    Such families are used only if there is no other.
    """
    known = {
        family.id: family for effect_id in comparison.best.ids for family in families_of(effect_id)
    }
    tried = _list_tried(comparison)
    suitable = {}
    for name, family in known.items():
        # A changed value is a candidate only beside a reference.
        members = members_of(name) - (VALUE_OF_CHANGE.keys() - tried)
        if 3 * len(members & tried) >= len(members):
            suitable[name] = family
    return suitable or known


def _list_tried(comparison: Comparison) -> frozenset[str]:
    """The effects that the recordings show, each of which was tried."""
    probed = {probe.choice.effect.id for probe in comparison.result.probes}
    return frozenset(probed.union(comparison.best.ids))


def _criteria(
    hypothesis: ScaledHypothesis, supported: Sequence[Supported]
) -> tuple[Criterion, ...]:
    """What a hypothesis must meet to be identified; for the one without effects, to lack nothing.

    A law may fail in a few conditions, for example where a stop is reached. Where nothing is
    missing, no condition is predicted badly.
    """
    misfit = hypothesis.misfit if hypothesis.ids else hypothesis.misfit_of_all
    least = min((effect.probability for effect in supported), default=1.0)
    strained = describe_strain(hypothesis)
    needed = f"{IDENTIFIED_PROBABILITY:g} needed"
    at_most = f"{USUAL_MISFIT:g} at most"
    near = f"each within {IMPLAUSIBLE:g} prior standard deviations"
    probable = Criterion(
        PROBABLE,
        least >= IDENTIFIED_PROBABILITY,
        f"{least:.3f} that every effect is there, {needed}",
        needed,
    )
    return (
        *((probable,) if supported else ()),
        Criterion(
            HELD_OUT,
            misfit <= USUAL_MISFIT,
            f"{misfit:.2f} of what noise and a usual model error make, {at_most}",
            at_most,
        ),
        Criterion(
            PLAUSIBLE,
            not strained,
            strained or "all nuisance parameters are near their priors",
            near,
        ),
    )


def describe_strain(one: ScaledHypothesis) -> str:
    """Implausible nuisance parameters in words; empty where there are none."""
    names = one.hypothesis.fitted.coordinates.space.names
    x = one.hypothesis.fitted.x
    nuisances = zip(names, x, one.nuisance_shifts, strict=False)
    off = "prior standard deviations off"
    # At the bound the printed value is the fit's, not the one that the data ask for.
    return "; ".join(
        f"{name} {z:+.1f} {off}{', the bound of the fit' if abs(z) >= MAX_COORDINATE else ''}"
        for name, z, shift in nuisances
        if abs(shift) > IMPLAUSIBLE
    )


def _best_family(
    comparison: Comparison, supported: Sequence[Supported], of: Collection[str]
) -> StatedFamily | None:
    """The most probable family of some effects of the best explanation; of two that are as
    probable, the larger one, which claims less.
    """
    known = {
        name: family
        for name, family in _families_of_best(comparison).items()
        if not members_of(name).isdisjoint(of)
    }
    families = [
        support
        for support in supported
        if support.kind == "family" and support.is_needed and support.id in known
    ]
    if not families:
        return None
    best = max(
        families,
        key=lambda support: (support.probability, len(members_of(support.id)), support.id),
    )
    return _state_family(comparison, known[best.id], best.probability)


def _state_family(comparison: Comparison, family: Family, probability: float) -> StatedFamily:
    """The family with those of its members that were tried."""
    members = tuple(sorted(members_of(family.id) & _list_tried(comparison)))
    return StatedFamily(family.id, family.words, family.place, probability, members)


def _other_families(
    comparison: Comparison, supported: Sequence[Supported], stated: Collection[str]
) -> tuple[StatedFamily, ...]:
    """Families that are sure, of the effects of the best explanation that are not among the stated
    ones.

    Each has an effect that those before do not have.
    """
    families: list[StatedFamily] = []
    left = set(comparison.best.ids) - set(stated)
    while left:
        family = _best_family(comparison, supported, left)
        # What is small beside a statement is more often wrong than the statement itself.
        if family is None or family.probability < IDENTIFIED_PROBABILITY:
            break
        families.append(family)
        left -= set(family.members)
    return tuple(families)


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


def rank_rivals(comparison: Comparison) -> tuple[Rival, ...]:
    """All sets of effects with their relative probabilities, most probable first; variants of one
    effect count as one.

    "Nothing missing" allows the usual model error only, "unknown" a larger one. The discrepancy
    scale of a set with effects is free.
    """
    joint: dict[tuple[str, ...], list[tuple[float, float, float]]] = {}
    for scaled in comparison.ranked:
        if scaled.ids:
            joint.setdefault(tuple(sorted(scaled.ids)), []).append(
                (scaled.log_joint, scaled.log_joint - scaled.hypothesis.log_prior, scaled.scale)
            )
    nothing = comparison.result.nothing
    unknown = comparison.result.unknown
    joint[()] = [(nothing.log_joint, nothing.marginal.log_evidence, nothing.marginal.error)]
    joint[UNKNOWN] = [
        (unknown.log_evidence + float(np.log(PRIOR_UNKNOWN)), unknown.log_evidence, unknown.error)
    ]
    logs = {}
    for ids, variants in joint.items():
        logs[ids] = float(logsumexp([log_joint for log_joint, _, _ in variants]))
    total = float(logsumexp(list(logs.values())))
    rivals = []
    for ids, variants in joint.items():
        log_joint, evidence, error = max(variants)
        probability = float(np.exp(logs[ids] - total))
        prior = float(np.exp(log_joint - evidence))
        rivals.append(Rival(ids, probability, evidence, error, prior))
    return tuple(sorted(rivals, key=lambda rival: -rival.probability))


def join_decisions(forces: Decision, shaft: Decision) -> Decision:
    """One answer from those about the forces and about the motion of the shaft, treated as
    independent: the weaker of what is stated.

    It is "mostly" where one of the two stays unexplained. The explanation is that of the forces.
    """
    decisions = (forces, shaft)
    grades = {forces.grade, shaft.grade}
    stated = [
        decision for decision in decisions if decision.grade in ("identified", "mostly", "family")
    ]
    # What is visible within the usual error of one of the two says nothing against what is
    # identified in the other.
    if "identified" in grades and all(
        decision.grade in ("identified", "nothing missing") or decision.within_usual
        for decision in decisions
    ):
        grade: Grade = "identified"
    elif forces.effects or shaft.effects:
        grade = "mostly"
    else:
        grade = next(
            candidate
            for candidate in ("family", "unexplained", "nothing missing")
            if candidate in grades
        )
    # Nothing is missing only if nothing is missing in either of them.
    nothing = float(
        np.prod(
            [
                decision.probability
                if decision.grade == "nothing missing"
                else 1.0 - decision.probability
                for decision in decisions
            ]
        )
    )
    rivals = _combine_tables(forces.list_rivals(MOST_RIVALS), shaft.list_rivals(MOST_RIVALS))
    families = [decision.family for decision in decisions if decision.family is not None]
    effects = (*forces.effects, *shaft.effects)
    stated_ids = {effect.id for effect in effects}
    # The family of a stated effect says nothing more.
    further_families = [
        family
        for family in (*families[1:], *forces.other_families, *shaft.other_families)
        if stated_ids.isdisjoint(family.members)
    ]
    # What is visible within the usual error is no criterion of what is identified in the other
    # part.
    judged = [
        decision
        for decision in decisions
        if decision.grade != "nothing missing"
        and (grade != "identified" or decision.grade == "identified")
    ]
    if stated:
        probability = min(decision.probability for decision in stated)
    elif grade == "nothing missing":
        probability = nothing
    else:
        probability = 1.0 - nothing
    return Decision(
        grade=grade,
        explanation=forces.explanation,
        closest=next(
            (decision.closest for decision in decisions if decision.closest is not None), None
        ),
        effects=effects,
        not_stated={**forces.not_stated, **shaft.not_stated},
        family=families[0] if families else None,
        other_families=tuple(further_families),
        probability=probability,
        explained_share=min((decision.explained_share for decision in stated), default=1.0),
        relieved_strain=next(
            (decision.relieved_strain for decision in stated if decision.relieved_strain), ""
        ),
        criteria=tuple(criterion for decision in judged for criterion in decision.criteria),
        rivals=rivals,
        supported=(*forces.supported, *shaft.supported),
        alternatives=list_alternatives(rivals) if grade == "unexplained" else (),
        within_usual=forces.within_usual and shaft.within_usual,
    )


def _combine_tables(forces: Sequence[Rival], shaft: Sequence[Rival]) -> tuple[Rival, ...]:
    """The table of all pairs of rows, most probable first; something unlisted in both parts is
    one row.
    """
    rows: dict[tuple[str, ...], Rival] = {}
    for a in forces:
        for b in shaft:
            ids = tuple(dict.fromkeys((*a.ids, *b.ids)))
            row = Rival(
                ids,
                a.probability * b.probability,
                a.log_evidence + b.log_evidence,
                max(a.model_error, b.model_error),
                None if a.prior is None or b.prior is None else a.prior * b.prior,
            )
            known = rows.get(ids)
            if known is None:
                rows[ids] = row
            else:
                rows[ids] = replace(
                    max(known, row, key=_probability),
                    probability=known.probability + row.probability,
                )
    return tuple(sorted(rows.values(), key=_probability, reverse=True))


def _probability(rival: Rival) -> float:
    return rival.probability
