"""Support of effects and families, and families in place of effects or beside them."""

from collections.abc import Collection, Sequence
from dataclasses import replace

from rfca_rig.diagnosis.config import IDENTIFIED_PROBABILITY
from rfca_rig.diagnosis.decision.calibration import calibration_of, support_values
from rfca_rig.diagnosis.decision.comparison import Comparison
from rfca_rig.diagnosis.decision.decision import Decision, Supported
from rfca_rig.diagnosis.result import NamedEffect, StatedFamily
from rfca_rig.model.catalogue import families_of, list_related, members_of
from rfca_rig.model.declarations.changes import VALUE_OF_CHANGE
from rfca_rig.model.families import Family

AS_ITS_FAMILY = "the data tell it from no other law of its family, which is stated in its place"
# Laws that look alike and are called by the name of their family; fewer are named.
FEWEST_ALIKE = 3


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
    for family in list_families(comparison).values():
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


def list_families(comparison: Comparison) -> dict[str, Family]:
    """Families of the effects of the best explanation, by id.

    A family of which less than a third of the members were tried belongs to another kind of rig.
    Such families are used only if there is no other.
    """
    known = {
        family.id: family for effect_id in comparison.best.ids for family in families_of(effect_id)
    }
    tried = list_tried(comparison)
    suitable = {}
    for name, family in known.items():
        # A changed value is a candidate only beside a reference.
        members = members_of(name) - (VALUE_OF_CHANGE.keys() - tried)
        if 3 * len(members & tried) >= len(members):
            suitable[name] = family
    return suitable or known


def list_tried(comparison: Comparison) -> frozenset[str]:
    """The effects that the recordings show, each of which was tried."""
    probed = {probe.choice.effect.id for probe in comparison.result.probes}
    return frozenset(probed.union(comparison.best.ids))


def find_best_family(
    comparison: Comparison, supported: Sequence[Supported], of: Collection[str]
) -> StatedFamily | None:
    """The most probable family of some effects of the best explanation; of two that are as
    probable, the larger one, which claims less.
    """
    known = {
        name: family
        for name, family in list_families(comparison).items()
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
    members = tuple(sorted(members_of(family.id) & list_tried(comparison)))
    return StatedFamily(family.id, family.words, family.place, probability, members)


def find_other_families(
    comparison: Comparison, supported: Sequence[Supported], stated: Collection[str]
) -> tuple[StatedFamily, ...]:
    """Families that are sure, of the effects of the best explanation that are not among the stated
    ones.

    Each has an effect that those before do not have.
    """
    families: list[StatedFamily] = []
    left = set(comparison.best.ids) - set(stated)
    while left:
        family = find_best_family(comparison, supported, left)
        # What is small beside a statement is more often wrong than the statement itself.
        if family is None or family.probability < IDENTIFIED_PROBABILITY:
            break
        families.append(family)
        left -= set(family.members)
    return tuple(families)


def name_families(
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
            family=find_best_family(comparison, supported, [effect.id for effect in named])
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
    tried = list_tried(comparison)
    alike = {effect.id, *effect.cannot_tell_from}
    laws_alike = comparison.laws_of(alike & tried)
    if len(laws_alike) < FEWEST_ALIKE:
        return None
    # A variant that is told apart, as a law in one joint alone, says nothing against the law.
    told_apart = comparison.laws_of(comparison.tells_from(effect.id)) - laws_alike
    # An effect and a family may share their id.
    probabilities = {
        support.id: support.probability for support in supported if support.kind == "family"
    }
    for family in sorted(list_families(comparison).values(), key=_count_members):
        members = members_of(family.id)
        is_whole = alike <= members and told_apart.isdisjoint(members)
        if is_whole and probabilities[family.id] >= IDENTIFIED_PROBABILITY:
            return _state_family(comparison, family, probabilities[family.id])
    return None


def _count_members(family: Family) -> int:
    return len(members_of(family.id))
