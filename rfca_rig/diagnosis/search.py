"""All hypotheses that matter: nothing missing, something unlisted, each effect, and pairs that build on the best effects."""

from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from rfca_rig.diagnosis.conventions import held_anyhow, with_likeliest_moves
from rfca_rig.diagnosis.coordinates import Coordinates
from rfca_rig.diagnosis.descent import Descent, Fitted, unscattered
from rfca_rig.diagnosis.evidence import THREADS, Evidence
from rfca_rig.diagnosis.growing import grown
from rfca_rig.diagnosis.handing_over import handed_over
from rfca_rig.diagnosis.hypotheses import Found, weighed
from rfca_rig.diagnosis.judging import GOOD_FIT, judge_of
from rfca_rig.diagnosis.pairing import CLEARLY_NEEDED, exchanged, no_worse_than_nested, paired, without
from rfca_rig.diagnosis.refining import refined, worth_trying
from rfca_rig.diagnosis.scatter import Scatter, scatter_of
from rfca_rig.diagnosis.screening import Trial, choices_of, tried
from rfca_rig.diagnosis.second_look import Belief, explains, is_astray, is_lost, pairs_from_belief, singles_from_belief
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
class _Standing:
    """How far a search has come: the model with nothing missing, `base`, effects alone, and pairs of them, each where it fits best; and
    whether what scatters and how the tip was held are `learnt` from one of them.
    """

    descent: Descent
    scatter: Scatter
    base: Fitted
    singles: tuple[Fitted, ...] = ()
    pairs: tuple[Fitted, ...] = ()
    learnt: bool = False

    @property
    def best(self) -> Fitted:
        return max((self.base, *self.singles, *self.pairs), key=self.descent.log_evidence)


def searched(
    evidence: Evidence, coordinates: Coordinates, effects: Sequence[Effect], progress: Progress, stopped_as_told: bool = True
) -> Found:
    """The search over these effects and their pairs; `stopped_as_told` says whether the shaft stood where it was told in static stages.

    Raises SimulationFailed where the model cannot be computed as believed.
    """
    progress("nothing missing", 0.0)
    believed, standing = _begun(held_anyhow(evidence), coordinates)
    progress("a first look at every effect", 0.1)
    there = believed if is_lost(standing.descent, standing.base) else standing.base
    choices = tuple(choice for effect in effects for choice in choices_of(effect))
    trials = tried(standing.descent.evidence, there, choices)
    belief = Belief(believed, standing.descent.evidence, choices, tuple(trials) if there is believed else ())
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
    believed = standing.descent.at(coordinates, believed.x, believed.slope) or believed
    nothing, named = weighed(standing.descent, standing.base, (*standing.singles, *standing.pairs), len(effects))
    unknown = standing.descent.judged_unlisted(standing.base)
    evidence, judge = standing.descent.evidence, standing.descent.judge
    return Found(believed, nothing, unknown, named, tuple(trials), standing.scatter, judge, evidence)


def _begun(evidence: Evidence, coordinates: Coordinates) -> tuple[Fitted, _Standing]:
    """The model as believed, and where it fits best with nothing missing."""
    start = unscattered(evidence)
    believed = start.at(coordinates, np.zeros(coordinates.size))
    if believed is None:
        raise SimulationFailed("the model cannot be computed as believed; look for a slipped decimal point in the leg or the ground")
    base = start.descended(believed)
    scatter = scatter_of(evidence, coordinates.supposed(base.x))
    descent = Descent(evidence, judge_of(evidence.rows, scatter.columns))
    return believed, _Standing(descent, scatter, descent.polished(base))


def _with_singles(standing: _Standing, there: Fitted, trials: Sequence[Trial], belief: Belief, stopped_as_told: bool) -> _Standing:
    """The effects that promise most beside what is `there`, and from what is believed where none of them explains anything."""
    descent, base = standing.descent, standing.base
    singles = refined(descent, there, worth_trying(descent, there, trials, REFINED))
    if _all_lost(descent, (base, *singles)):
        singles = _each_at_its_best(descent, [*singles, *singles_from_belief(descent, belief)])
    standing, best = replace(standing, singles=tuple(singles)), _clearly_better(descent, base, singles) or base
    if descent.judged(best).fits_well(base.coordinates.nuisances):
        standing = _learnt_anew(standing, best, stopped_as_told)
    standing = _beside_what_lacks_nothing(standing, trials)
    singles = _best_polished(standing.descent, standing.singles)
    return replace(standing, singles=tuple(singles), base=_polished_if_near(standing.descent, standing.base, singles))


def _beside_what_lacks_nothing(standing: _Standing, trials: Sequence[Trial]) -> _Standing:
    """An effect may owe its lead to the believed values that came with it: nothing missing is fitted again from these, and where it does
    clearly better there than it stood, effects are put beside it anew.
    """
    descent, base = standing.descent, standing.base
    best = _clearly_better(descent, base, standing.singles)
    begun = None if best is None else without(descent, best, 0)
    if begun is None or (again := _clearly_better(descent, base, [descent.polished(descent.descended(begun))])) is None:
        return standing
    more = refined(descent, again, worth_trying(descent, again, trials, REFINED))
    return replace(standing, base=again, singles=tuple(_each_at_its_best(descent, [*standing.singles, *more])))


def _with_pairs(standing: _Standing, trials: Sequence[Trial]) -> _Standing:
    descent, singles = standing.descent, standing.singles
    pairs = [] if _all_lost(descent, singles) else paired(descent, standing.base, singles, trials)
    return replace(standing, pairs=tuple(_best_polished(descent, pairs)))


def _explained(standing: _Standing, belief: Belief, trials: Sequence[Trial], stopped_as_told: bool) -> _Standing:
    """What is tried where nothing explains the recordings well, one after the other until something explains them."""
    best = [*_best(standing.descent, standing.singles, GROWN_ALONE), *_best(standing.descent, standing.pairs, GROWN_TOGETHER)]
    standing = _grown(standing, best, trials)
    if is_astray(standing.descent, standing.base) and not explains(standing.descent, standing.best):
        standing = _with_pairs_from_belief(standing, belief)
    if explains(standing.descent, standing.best) or not standing.pairs:
        return standing
    standing = _learnt_at_last(standing, stopped_as_told)
    (pair,) = _best(standing.descent, standing.pairs, 1)
    return _grown(standing, exchanged(standing.descent, pair, trials), trials)


def _grown(standing: _Standing, fits: Sequence[Fitted], trials: Sequence[Trial]) -> _Standing:
    """These begun anew along growing strokes; pairs are sought again beside an effect that gets much further."""
    descent = standing.descent
    again = grown(descent, fits)
    singles, pairs = ([fitted for fitted in again if len(fitted.coordinates.choices) == count] for count in (1, 2))
    pairs = _each_at_its_best(descent, [*standing.pairs, *pairs])
    return _pairs_again(replace(standing, pairs=tuple(pairs)), _each_at_its_best(descent, [*standing.singles, *singles]), trials)


def _with_parts_again(standing: _Standing, trials: Sequence[Trial]) -> _Standing:
    """The parts of the best pair fitted again; pairs are built anew where that shows an effect in a much better light than it stood in."""
    return _pairs_again(standing, no_worse_than_nested(standing.descent, standing.base, standing.singles, standing.pairs), trials)


def _pairs_again(standing: _Standing, singles: Sequence[Fitted], trials: Sequence[Trial]) -> _Standing:
    """With these effects instead, and pairs built anew where the best of them is much better than it stood."""
    descent = standing.descent
    best, before = (max(map(descent.log_evidence, fits), default=-np.inf) for fits in (singles, standing.singles))
    again = replace(standing, singles=tuple(singles))
    if best < before + CLEARLY_NEEDED:
        return again
    return replace(again, pairs=tuple(_each_at_its_best(descent, [*standing.pairs, *_with_pairs(again, trials).pairs])))


def _with_nothing_again(standing: _Standing) -> _Standing:
    """Nothing missing fitted again from the believed values of the best explanation, which may have found a better place for them."""
    descent, base, best = standing.descent, standing.base, standing.best
    nuisances = base.coordinates.nuisances
    begun = descent.at(base.coordinates, best.x[:nuisances])
    again = None if begun is None else _clearly_better(descent, base, [descent.descended(begun)])
    return standing if again is None else replace(standing, base=descent.polished(again))


def _with_pairs_from_belief(standing: _Standing, belief: Belief) -> _Standing:
    """More pairs, those that promise most from what is believed."""
    again = _best_polished(standing.descent, pairs_from_belief(standing.descent, belief))
    return replace(standing, pairs=tuple(_each_at_its_best(standing.descent, [*standing.pairs, *again])))


def _learnt_anew(standing: _Standing, best: Fitted, stopped_as_told: bool) -> _Standing:
    """What scatters acts through the leg and drive as they are, and how a static table was moved through shows in how its tip was held:
    both learnt anew from the best explanation, and all fits carried on. From one that explains next to nothing the wrong would be learnt.
    """
    moved = with_likeliest_moves(standing.descent.evidence, best.coordinates, best.x, stopped_as_told)
    if moved is standing.descent.evidence and not best.coordinates.choices:
        return replace(standing, learnt=True)
    scatter = scatter_of(moved, best.coordinates.supposed(best.x))
    descent = Descent(moved, judge_of(moved.rows, scatter.columns))
    base = _carried_on(descent, standing.base)
    singles, pairs = (tuple(_carried_on(descent, fitted) for fitted in fits) for fits in (standing.singles, standing.pairs))
    return _Standing(descent, scatter, base, singles, pairs, learnt=True)


def _learnt_at_last(standing: _Standing, stopped_as_told: bool) -> _Standing:
    """The same from the best explanation there is, if it is one or comes close to the recordings all the same."""
    descent, best = standing.descent, standing.best
    if standing.learnt or not (explains(descent, best) or descent.judged(best).error < GOOD_FIT):
        return standing
    standing = _learnt_anew(standing, standing.best, stopped_as_told)
    descent = standing.descent
    singles, pairs = (tuple(_best_polished(descent, fits)) for fits in (standing.singles, standing.pairs))
    return replace(standing, base=_polished_if_near(descent, standing.base, (*singles, *pairs)), singles=singles, pairs=pairs)


def _carried_on(descent: Descent, fitted: Fitted) -> Fitted:
    """A fit to other evidence, fitted to this from where it stands; as it was where the model has no answer there."""
    here = descent.at(fitted.coordinates, fitted.x, fitted.slope)
    return fitted if here is None else descent.descended(here)


def _best(descent: Descent, fits: Sequence[Fitted], count: int) -> list[Fitted]:
    return sorted(fits, key=descent.log_evidence, reverse=True)[:count]


def _each_at_its_best(descent: Descent, fits: Sequence[Fitted]) -> list[Fitted]:
    """The best fit of each set of effects."""
    return list({frozenset(fitted.coordinates.choices): fitted for fitted in sorted(fits, key=descent.log_evidence)}.values())


def _all_lost(descent: Descent, fits: Sequence[Fitted]) -> bool:
    """Whether there is none, or even the best explains next to nothing."""
    return not fits or is_lost(descent, max(fits, key=descent.log_evidence))


def _explains_well(descent: Descent, fitted: Fitted) -> bool:
    """Whether nothing better need be looked for: half of an explanation, or a wrong one, may explain with a large error of the model."""
    return explains(descent, fitted) and descent.judged(fitted).error < POOR_FIT


def _polished_if_near(descent: Descent, base: Fitted, singles: Sequence[Fitted]) -> Fitted:
    best = max((descent.log_evidence(single) for single in singles), default=-np.inf)
    return descent.polished(base) if descent.log_evidence(base) > best - FAR_BELOW else base


def _clearly_better(descent: Descent, base: Fitted, singles: Sequence[Fitted]) -> Fitted | None:
    """The best of them, if it leaves the base far behind."""
    best = max(singles, key=descent.log_evidence, default=None)
    return None if best is None or descent.log_evidence(best) < descent.log_evidence(base) + CLEARLY_BETTER else best


def _best_polished(descent: Descent, fits: Sequence[Fitted]) -> list[Fitted]:
    """The likeliest at its very best point, and those few that come near it; the others stay as they are, far below.

    Where even the best explains next to nothing its order says little, and those few are polished whatever they are worth.
    """
    ranked = sorted(fits, key=descent.log_evidence, reverse=True)
    if not ranked:
        return []
    best = descent.polished(ranked[0])
    least = -np.inf if is_lost(descent, ranked[0]) else descent.log_evidence(best) - FAR_BELOW
    near = [f for f in ranked[1:POLISHED_BEST] if descent.log_evidence(f) > least]
    with ThreadPoolExecutor(THREADS) as pool:
        polished = [best, *pool.map(descent.polished, near)]
        least = np.inf if _all_lost(descent, polished) else max(map(descent.log_evidence, polished)) - NEARLY_AS_GOOD
        led = pool.map(lambda f: handed_over(descent, f) if descent.log_evidence(f) >= least else f, polished)
        return [*led, *ranked[1 + len(near) :]]
