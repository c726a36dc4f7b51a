"""All hypotheses that matter: nothing missing, something unlisted, each effect, and pairs that build on the best effects."""

from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from rfca_rig.diagnosis.data.dataset import THREADS, Dataset
from rfca_rig.diagnosis.data.static_history import with_free_friction, with_inferred_approach
from rfca_rig.diagnosis.inference.continuation import continue_from_beginnings
from rfca_rig.diagnosis.inference.forward_selection import CLEARLY_NEEDED, no_worse_than_nested, select_pairs, swap_effects, without
from rfca_rig.diagnosis.inference.hypotheses import ModelSelectionResult, weigh_models
from rfca_rig.diagnosis.inference.map_fit import GaussNewton, MapFit, without_scatter
from rfca_rig.diagnosis.inference.nuisance_swap import swap_nuisance
from rfca_rig.diagnosis.inference.optimize import optimize, worth_trying
from rfca_rig.diagnosis.inference.parameterization import Parameterization
from rfca_rig.diagnosis.inference.restart_from_prior import (
    NominalFit,
    fits_worse_than_unknown,
    is_adequate,
    nuisances_out_of_range,
    pairs_from_belief,
    singles_from_belief,
)
from rfca_rig.diagnosis.inference.screening import EffectProbe, probe_effects, terms_of
from rfca_rig.diagnosis.likelihood.marginal_likelihood import GOOD_FIT, make_marginal_likelihood
from rfca_rig.diagnosis.likelihood.repeat_scatter import Scatter, estimate_scatter
from rfca_rig.errors import SimulationFailed
from rfca_rig.model.effect import Effect

Floats = NDArray[np.float64]
Progress = Callable[[str, float], None]

REFINED = 7  # effects whose best point is sought, of those that screening ranks highest
GROWN_ALONE, GROWN_TOGETHER = 3, 4  # effects, and pairs of them, that are begun anew where none explains
POLISHED_BEST = 3  # hypotheses of each size that are brought to their very best point
POOR_FIT = 0.015  # a model error from which on a better explanation is looked for
CLEARLY_BETTER = 10.0  # log evidence
FAR_BELOW, NEARLY_AS_GOOD = 100.0, 20.0  # log evidence: more than polishing brings; where handing over may decide


@dataclass(frozen=True)
class SearchState:
    """How far a search has come: the model with nothing missing, `base`, effects alone, and pairs of them, each where it fits best; and
    whether what scatters and how the tip was held are `learnt` from one of them.
    """

    descent: GaussNewton
    scatter: Scatter
    base: MapFit
    singles: tuple[MapFit, ...] = ()
    pairs: tuple[MapFit, ...] = ()
    learnt: bool = False

    @property
    def best(self) -> MapFit:
        return max((self.base, *self.singles, *self.pairs), key=self.descent.log_evidence)


def search_models(
    evidence: Dataset, coordinates: Parameterization, effects: Sequence[Effect], progress: Progress, stopped_as_told: bool = True
) -> ModelSelectionResult:
    """The search over these effects and their pairs; `stopped_as_told` says whether the shaft stood where it was told in static stages.

    Raises SimulationFailed where the model cannot be computed as believed.
    """
    progress("nothing missing", 0.0)
    believed, standing = _begun(with_free_friction(evidence), coordinates)
    progress("a first look at every effect", 0.1)
    there = believed if fits_worse_than_unknown(standing.descent, standing.base) else standing.base
    choices = tuple(choice for effect in effects for choice in terms_of(effect))
    trials = probe_effects(standing.descent.evidence, there, choices)
    belief = NominalFit(believed, standing.descent.evidence, choices, tuple(trials) if there is believed else ())
    progress("each effect", 0.3)
    standing = _with_singles(standing, there, trials, belief, stopped_as_told)
    progress("pairs of effects", 0.6)
    standing = _with_pairs(standing, trials)
    if not _explains_well(standing.descent, standing.best):
        progress("along growing strokes", 0.75)
        standing = _explained(standing, belief, trials, stopped_as_told)
    progress("weighing", 0.9)
    standing = _learnt_at_last(standing, stopped_as_told)
    standing = _with_nothing_again(_with_parts_again(standing, trials))
    believed = standing.descent.at(coordinates, believed.x, believed.jacobian) or believed
    nothing, named = weigh_models(standing.descent, standing.base, (*standing.singles, *standing.pairs), len(effects))
    unknown = standing.descent.evaluate_unlisted(standing.base)
    evidence, judge = standing.descent.evidence, standing.descent.judge
    return ModelSelectionResult(believed, nothing, unknown, named, tuple(trials), standing.scatter, judge, evidence)


def _begun(evidence: Dataset, coordinates: Parameterization) -> tuple[MapFit, SearchState]:
    """The model as believed, and where it fits best with nothing missing."""
    start = without_scatter(evidence)
    believed = start.at(coordinates, np.zeros(coordinates.size))
    if believed is None:
        raise SimulationFailed("the model cannot be computed as believed; look for a slipped decimal point in the leg or the ground")
    base = start.refine(believed)
    scatter = estimate_scatter(evidence, coordinates.supposed(base.x))
    descent = GaussNewton(evidence, make_marginal_likelihood(evidence.rows, scatter.columns))
    return believed, SearchState(descent, scatter, descent.converge(base))


def _with_singles(
    standing: SearchState, there: MapFit, trials: Sequence[EffectProbe], belief: NominalFit, stopped_as_told: bool
) -> SearchState:
    """The effects that promise most beside what is `there`, and from what is believed where none of them explains anything."""
    descent, base = standing.descent, standing.base
    singles = optimize(descent, there, worth_trying(descent, there, trials, REFINED))
    if _all_lost(descent, (base, *singles)):
        singles = _each_at_its_best(descent, [*singles, *singles_from_belief(descent, belief)])
    standing, best = replace(standing, singles=tuple(singles)), _clearly_better(descent, base, singles) or base
    if descent.evaluate(best).fits_well(base.coordinates.nuisances):
        standing = _learnt_anew(standing, best, stopped_as_told)
    standing = _beside_what_lacks_nothing(standing, trials)
    singles = _best_polished(standing.descent, standing.singles)
    return replace(standing, singles=tuple(singles), base=_polished_if_near(standing.descent, standing.base, singles))


def _beside_what_lacks_nothing(standing: SearchState, trials: Sequence[EffectProbe]) -> SearchState:
    """An effect may owe its lead to the believed values that came with it: nothing missing is fitted again from these, and where it does
    clearly better there than it stood, effects are put beside it anew.
    """
    descent, base = standing.descent, standing.base
    best = _clearly_better(descent, base, standing.singles)
    begun = None if best is None else without(descent, best, 0)
    if begun is None or (again := _clearly_better(descent, base, [descent.converge(descent.refine(begun))])) is None:
        return standing
    more = optimize(descent, again, worth_trying(descent, again, trials, REFINED))
    return replace(standing, base=again, singles=tuple(_each_at_its_best(descent, [*standing.singles, *more])))


def _with_pairs(standing: SearchState, trials: Sequence[EffectProbe]) -> SearchState:
    descent, singles = standing.descent, standing.singles
    pairs = [] if _all_lost(descent, singles) else select_pairs(descent, standing.base, singles, trials)
    return replace(standing, pairs=tuple(_best_polished(descent, pairs)))


def _explained(standing: SearchState, belief: NominalFit, trials: Sequence[EffectProbe], stopped_as_told: bool) -> SearchState:
    """What is tried where nothing explains the recordings well, one after the other until something explains them."""
    best = [*_best(standing.descent, standing.singles, GROWN_ALONE), *_best(standing.descent, standing.pairs, GROWN_TOGETHER)]
    standing = _grown(standing, best, trials)
    if nuisances_out_of_range(standing.descent, standing.base) and not is_adequate(standing.descent, standing.best):
        standing = _with_pairs_from_belief(standing, belief)
    if is_adequate(standing.descent, standing.best) or not standing.pairs:
        return standing
    standing = _learnt_at_last(standing, stopped_as_told)
    (pair,) = _best(standing.descent, standing.pairs, 1)
    return _grown(standing, swap_effects(standing.descent, pair, trials), trials)


def _grown(standing: SearchState, fits: Sequence[MapFit], trials: Sequence[EffectProbe]) -> SearchState:
    """These begun anew along growing strokes; pairs are sought again beside an effect that gets much further."""
    descent = standing.descent
    again = continue_from_beginnings(descent, fits)
    singles, pairs = ([fitted for fitted in again if len(fitted.coordinates.choices) == count] for count in (1, 2))
    pairs = _each_at_its_best(descent, [*standing.pairs, *pairs])
    return _pairs_again(replace(standing, pairs=tuple(pairs)), _each_at_its_best(descent, [*standing.singles, *singles]), trials)


def _with_parts_again(standing: SearchState, trials: Sequence[EffectProbe]) -> SearchState:
    """The parts of the best pair fitted again; pairs are built anew where that shows an effect in a much better light than it stood in."""
    return _pairs_again(standing, no_worse_than_nested(standing.descent, standing.base, standing.singles, standing.pairs), trials)


def _pairs_again(standing: SearchState, singles: Sequence[MapFit], trials: Sequence[EffectProbe]) -> SearchState:
    """With these effects instead, and pairs built anew where the best of them is much better than it stood."""
    descent = standing.descent
    best, before = (max(map(descent.log_evidence, fits), default=-np.inf) for fits in (singles, standing.singles))
    again = replace(standing, singles=tuple(singles))
    if best < before + CLEARLY_NEEDED:
        return again
    return replace(again, pairs=tuple(_each_at_its_best(descent, [*standing.pairs, *_with_pairs(again, trials).pairs])))


def _with_nothing_again(standing: SearchState) -> SearchState:
    """Nothing missing fitted again from the believed values of the best explanation, which may have found a better place for them."""
    descent, base, best = standing.descent, standing.base, standing.best
    nuisances = base.coordinates.nuisances
    begun = descent.at(base.coordinates, best.x[:nuisances])
    again = None if begun is None else _clearly_better(descent, base, [descent.refine(begun)])
    return standing if again is None else replace(standing, base=descent.converge(again))


def _with_pairs_from_belief(standing: SearchState, belief: NominalFit) -> SearchState:
    """More pairs, those that promise most from what is believed."""
    again = _best_polished(standing.descent, pairs_from_belief(standing.descent, belief))
    return replace(standing, pairs=tuple(_each_at_its_best(standing.descent, [*standing.pairs, *again])))


def _learnt_anew(standing: SearchState, best: MapFit, stopped_as_told: bool) -> SearchState:
    """What scatters acts through the leg and drive as they are, and how a static table was moved through shows in how its tip was held:
    both learnt anew from the best explanation, and all fits carried on. From one that explains next to nothing the wrong would be learnt.
    """
    moved = with_inferred_approach(standing.descent.evidence, best.coordinates, best.x, stopped_as_told)
    if moved is standing.descent.evidence and not best.coordinates.choices:
        return replace(standing, learnt=True)
    scatter = estimate_scatter(moved, best.coordinates.supposed(best.x))
    descent = GaussNewton(moved, make_marginal_likelihood(moved.rows, scatter.columns))
    base = _carried_on(descent, standing.base)
    singles, pairs = (tuple(_carried_on(descent, fitted) for fitted in fits) for fits in (standing.singles, standing.pairs))
    return SearchState(descent, scatter, base, singles, pairs, learnt=True)


def _learnt_at_last(standing: SearchState, stopped_as_told: bool) -> SearchState:
    """The same from the best explanation there is, if it is one or comes close to the recordings all the same."""
    descent, best = standing.descent, standing.best
    if standing.learnt or not (is_adequate(descent, best) or descent.evaluate(best).error < GOOD_FIT):
        return standing
    standing = _learnt_anew(standing, standing.best, stopped_as_told)
    descent = standing.descent
    singles, pairs = (tuple(_best_polished(descent, fits)) for fits in (standing.singles, standing.pairs))
    return replace(standing, base=_polished_if_near(descent, standing.base, (*singles, *pairs)), singles=singles, pairs=pairs)


def _carried_on(descent: GaussNewton, fitted: MapFit) -> MapFit:
    """A fit to other evidence, fitted to this from where it stands; as it was where the model has no answer there."""
    here = descent.at(fitted.coordinates, fitted.x, fitted.jacobian)
    return fitted if here is None else descent.refine(here)


def _best(descent: GaussNewton, fits: Sequence[MapFit], count: int) -> list[MapFit]:
    return sorted(fits, key=descent.log_evidence, reverse=True)[:count]


def _each_at_its_best(descent: GaussNewton, fits: Sequence[MapFit]) -> list[MapFit]:
    """The best fit of each set of effects."""
    return list({frozenset(fitted.coordinates.choices): fitted for fitted in sorted(fits, key=descent.log_evidence)}.values())


def _all_lost(descent: GaussNewton, fits: Sequence[MapFit]) -> bool:
    """Whether there is none, or even the best explains next to nothing."""
    return not fits or fits_worse_than_unknown(descent, max(fits, key=descent.log_evidence))


def _explains_well(descent: GaussNewton, fitted: MapFit) -> bool:
    """Whether nothing better need be looked for: half of an explanation, or a wrong one, may explain with a large error of the model."""
    return is_adequate(descent, fitted) and descent.evaluate(fitted).error < POOR_FIT


def _polished_if_near(descent: GaussNewton, base: MapFit, singles: Sequence[MapFit]) -> MapFit:
    best = max((descent.log_evidence(single) for single in singles), default=-np.inf)
    return descent.converge(base) if descent.log_evidence(base) > best - FAR_BELOW else base


def _clearly_better(descent: GaussNewton, base: MapFit, singles: Sequence[MapFit]) -> MapFit | None:
    """The best of them, if it leaves the base far behind."""
    best = max(singles, key=descent.log_evidence, default=None)
    return None if best is None or descent.log_evidence(best) < descent.log_evidence(base) + CLEARLY_BETTER else best


def _best_polished(descent: GaussNewton, fits: Sequence[MapFit]) -> list[MapFit]:
    """The likeliest at its very best point, and those few that come near it; the others stay as they are, far below.

    Where even the best explains next to nothing its order says little, and those few are polished whatever they are worth.
    """
    ranked = sorted(fits, key=descent.log_evidence, reverse=True)
    if not ranked:
        return []
    best = descent.converge(ranked[0])
    least = -np.inf if fits_worse_than_unknown(descent, ranked[0]) else descent.log_evidence(best) - FAR_BELOW
    near = [f for f in ranked[1:POLISHED_BEST] if descent.log_evidence(f) > least]
    with ThreadPoolExecutor(THREADS) as pool:
        converge = [best, *pool.map(descent.converge, near)]
        least = np.inf if _all_lost(descent, converge) else max(map(descent.log_evidence, converge)) - NEARLY_AS_GOOD
        led = pool.map(lambda f: swap_nuisance(descent, f) if descent.log_evidence(f) >= least else f, converge)
        return [*led, *ranked[1 + len(near) :]]
