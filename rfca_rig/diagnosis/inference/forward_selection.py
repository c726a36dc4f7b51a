"""Pairs of effects that build on the best ones, and their parts fitted again from where they stand."""

from collections.abc import Sequence

import numpy as np

from rfca_rig.diagnosis.inference.map_fit import GaussNewton, MapFit
from rfca_rig.diagnosis.inference.optimize import WORTH_A_FIT, optimize, relieving_of, worth_trying
from rfca_rig.diagnosis.inference.restart_from_prior import is_adequate
from rfca_rig.diagnosis.inference.screening import EffectProbe, probe_effects

BUILT_ON = 2  # effects that pairs are built on
HOPELESS = 500.0  # log evidence behind the best effect, below which no pair is built on one
PARTNERS = 4  # partners refined for each
CLEARLY_NEEDED = 120.0  # log evidence that a second effect must add to one that fits well: less, and the first's law may be a little off
CLEARLY_PROMISES = 60.0  # chi2 that it takes away beside the first as that stands; it takes several times as much once all have moved


def select_pairs(descent: GaussNewton, base: MapFit, singles: Sequence[MapFit], trials: Sequence[EffectProbe]) -> list[MapFit]:
    """Partners for the best effects, screened by what they would do to a leg that has the first one already.

    Where nothing would do and no effect adds much to it none is sought, and none beside the second best effect once a pair explains
    everything; beside an effect that fits well only what is worth much more than its law could be wrong by.
    """
    ranked = sorted(singles, key=descent.log_evidence, reverse=True)
    if not ranked or descent.log_evidence(ranked[0]) < _to_be_reached(descent, base):
        return []
    found: dict[frozenset[str], MapFit] = {}
    for single in _built_on(descent, ranked):
        own = ids_of(single)
        others = {(t.choice.effect.id, t.choice.whole): t.choice for t in trials if t.choice.effect.id not in own}
        looks = probe_effects(descent.evidence, single, list(others.values()))
        groups = worth_trying(descent, single, looks, PARTNERS, CLEARLY_PROMISES if _fits_well(descent, single) else WORTH_A_FIT)
        new = {frozenset((*own, group[0].choice.effect.id)): group for group in reversed(groups)}
        least = _to_be_reached(descent, single)
        fits = optimize(descent, single, [group for ids, group in new.items() if ids not in found])
        pairs = [pair for pair in fits if descent.log_evidence(pair) >= least]
        found |= {frozenset(ids_of(pair)): pair for pair in pairs}
        if pairs and is_adequate(descent, max(pairs, key=descent.log_evidence)):
            break
    return list(found.values())


def _to_be_reached(descent: GaussNewton, fitted: MapFit) -> float:
    """The log evidence that one effect more must bring: beside what fits well, more than a law that is a little off might."""
    return descent.log_evidence(fitted) + CLEARLY_NEEDED if _fits_well(descent, fitted) else -np.inf


def _fits_well(descent: GaussNewton, fitted: MapFit) -> bool:
    return descent.evaluate(fitted).fits_well(fitted.coordinates.nuisances)


def _built_on(descent: GaussNewton, ranked: Sequence[MapFit]) -> list[MapFit]:
    """The best, alone where it fits well, and those that it does not leave hopelessly behind."""
    many = 1 if _fits_well(descent, ranked[0]) else BUILT_ON
    least = descent.log_evidence(ranked[0]) - HOPELESS
    return [single for single in ranked[:many] if descent.log_evidence(single) >= least]


def swap_effects(descent: GaussNewton, pair: MapFit, trials: Sequence[EffectProbe]) -> list[MapFit]:
    """Each effect of a pair beside the one that its most strained nuisance calls for, instead of beside its partner."""
    parts = [part for number in range(2) if (part := without(descent, pair, number)) is not None]
    choices = list({trial.choice.effect.id: trial.choice for trial in trials if trial.choice.effect.same_as}.values())
    others = [[choice for choice in choices if choice.effect.id not in ids_of(part)] for part in parts]
    looks = [probe_effects(descent.evidence, part, more) for part, more in zip(parts, others, strict=True)]
    return [fit for part, look in zip(parts, looks, strict=True) for fit in optimize(descent, part, relieving_of(descent, pair, look))]


def no_worse_than_nested(descent: GaussNewton, base: MapFit, singles: Sequence[MapFit], pairs: Sequence[MapFit]) -> list[MapFit]:
    """A pair must not win because its parts were fitted badly: each part of a pair that would explain everything is fitted again from
    where the pair stands, and from where the base does.
    """
    best = max((*singles, *pairs), key=descent.log_evidence, default=base)
    if len(best.coordinates.choices) < 2 or not is_adequate(descent, best):
        return list(singles)
    kept = {fitted.coordinates.choices: fitted for fitted in singles}
    for part in (part for number in range(2) if (part := _part_again(descent, base, best, number)) is not None):
        before = kept.get(part.coordinates.choices)
        if before is None or descent.log_evidence(part) > descent.log_evidence(before):
            kept[part.coordinates.choices] = part
    return list(kept.values())


def _part_again(descent: GaussNewton, base: MapFit, pair: MapFit, number: int) -> MapFit | None:
    """The pair less one of its effects, at its very best point."""
    begun = [begin for begin in (without(descent, pair, number), _beside(descent, base, pair, number)) if begin is not None]
    return max((descent.converge(descent.refine(begin)) for begin in begun), key=descent.log_evidence, default=None)


def _beside(descent: GaussNewton, base: MapFit, pair: MapFit, number: int) -> MapFit | None:
    """The base with what the pair has but for one of its effects."""
    coordinates = pair.coordinates
    own = np.concatenate([pair.x[coordinates.part(i)] for i in range(len(coordinates.choices)) if i != number])
    kept = [choice for i, choice in enumerate(coordinates.choices) if i != number]
    return descent.at(coordinates.with_terms(kept), np.concatenate([base.x, own]))


def without(descent: GaussNewton, fitted: MapFit, number: int) -> MapFit | None:
    """The fit less one of its effects, all else where it stands; None where the model has no answer."""
    coordinates = fitted.coordinates
    kept = [choice for i, choice in enumerate(coordinates.choices) if i != number]
    drop = np.arange(coordinates.size)[coordinates.part(number)]
    return descent.at(coordinates.with_terms(kept), np.delete(fitted.x, drop), np.delete(fitted.jacobian, drop, axis=1))


def ids_of(fitted: MapFit) -> tuple[str, ...]:
    """The names of its effects."""
    return tuple(choice.effect.id for choice in fitted.coordinates.choices)
