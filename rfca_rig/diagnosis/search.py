"""All hypotheses that matter: nothing missing, something unlisted, each effect, and pairs that build on the best effects."""

from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from rfca_rig.diagnosis.coordinates import Coordinates
from rfca_rig.diagnosis.descent import Descent, Fitted
from rfca_rig.diagnosis.evidence import THREADS, Evidence
from rfca_rig.diagnosis.judging import Judge, Judgement, judge_of
from rfca_rig.diagnosis.scatter import Scatter, scatter_of
from rfca_rig.diagnosis.screening import Trial, choices_of, projection_of, tried
from rfca_rig.errors import SimulationFailed
from rfca_rig.model.effect import Effect

Floats = NDArray[np.float64]
Progress = Callable[[str, float], None]

REFINED = 7  # effects whose best point is sought, of those that screening ranks highest
POLISHED_BEST = 3  # hypotheses of each size that are brought to their very best point
CLEARLY_BETTER = 10.0  # log evidence
FAR_BELOW = 100.0  # log evidence: more than polishing brings
HOPELESS = 500.0  # log evidence behind the best effect, below which no pair is built on one
STARTS = 2  # places per effect to begin from, where the second promises half of the first
WORTH_A_FIT = 6.0  # chi2 that an effect must promise to take away, or it cannot pay for its parameters
GOOD_FIT = 0.011  # a model error below which no further effect is sought,
STRAINED = 2.5  # unless a nuisance is that many standard deviations from where it is believed
BUILT_ON = 2  # effects that pairs are built on
PARTNERS = 4  # partners refined for each
PRIOR_NOTHING, PRIOR_UNKNOWN, PRIOR_ONE, PRIOR_TWO = 0.5, 0.1, 0.3, 0.1


@dataclass(frozen=True)
class Hypothesis:
    """One answer: the ids of its effects, none for nothing missing; where it fits best, how well, and log prior probability."""

    ids: tuple[str, ...]
    fitted: Fitted
    judgement: Judgement
    log_prior: float

    @property
    def log_joint(self) -> float:
        """Log of prior times evidence."""
        return self.judgement.log_evidence + self.log_prior

    @property
    def rows(self) -> Floats:
        """What it says of every row, at its posterior mean."""
        return self.fitted.predicted + self.fitted.slope @ (self.judgement.posterior.mean - self.fitted.x)


@dataclass(frozen=True)
class Found:
    """Everything that the search leaves: the model as `believed`, `nothing` missing with all nuisances free, `unknown` (nothing named, a
    large error), and the hypotheses that name something, most plausible first.
    """

    believed: Fitted
    nothing: Hypothesis
    unknown: Judgement
    named: tuple[Hypothesis, ...]
    trials: tuple[Trial, ...]
    scatter: Scatter
    judge: Judge
    evidence: Evidence


def searched(evidence: Evidence, coordinates: Coordinates, effects: Sequence[Effect], progress: Progress) -> Found:
    """The search over these effects and their pairs. Raises SimulationFailed where the model cannot be computed as believed."""
    progress("nothing missing", 0.0)
    start = Descent(evidence, judge_of(evidence.rows, np.empty((len(evidence.rows.measured), 0))))
    believed = start.at(coordinates, np.zeros(coordinates.size))
    if believed is None:
        raise SimulationFailed("the model cannot be computed as believed; look for a slipped decimal point in the leg or the ground")
    base = start.descended(believed)
    scatter = scatter_of(evidence, coordinates.supposed(base.x))
    descent = Descent(evidence, judge_of(evidence.rows, scatter.columns))
    base = descent.polished(base)
    progress("a first look at every effect", 0.1)
    trials = tried(evidence, base, [choice for effect in effects for choice in choices_of(effect)])
    progress("each effect", 0.3)
    singles = _refined(descent, base, _promising(descent, base, trials, REFINED, STARTS))
    singles = _best_polished(descent, singles)
    better = _scatter_around_best(descent, base, singles)
    if better is not None:
        scatter, descent = better, Descent(evidence, judge_of(evidence.rows, better.columns))
        singles = _best_polished(descent, singles)
        base = _polished_if_near(descent, base, singles)
    progress("pairs of effects", 0.6)
    pairs = _best_polished(descent, _pairs(descent, base, singles, trials))
    progress("weighing", 0.9)
    singles = _no_worse_than_nested(descent, singles, pairs)
    return replace(_weighed(descent, base, [*singles, *pairs], trials, scatter, len(effects)), believed=believed)


def _polished_if_near(descent: Descent, base: Fitted, singles: Sequence[Fitted]) -> Fitted:
    best = max((_evidence(descent, single) for single in singles), default=-np.inf)
    return descent.polished(base) if _evidence(descent, base) > best - FAR_BELOW else base


def _scatter_around_best(descent: Descent, base: Fitted, singles: Sequence[Fitted]) -> Scatter | None:
    """What scatters acts through the leg and drive as they are: learnt anew where an effect describes them better."""
    best = max(singles, key=lambda single: _evidence(descent, single), default=None)
    if best is None or _evidence(descent, best) < _evidence(descent, base) + CLEARLY_BETTER:
        return None
    return scatter_of(descent.evidence, best.coordinates.supposed(best.x))


def _best_polished(descent: Descent, fits: Sequence[Fitted]) -> list[Fitted]:
    """The likeliest at its very best point, and those few that come near it; the others stay as they are, far below."""
    ranked = sorted(fits, key=lambda fitted: -_evidence(descent, fitted))
    best = [descent.polished(fitted) for fitted in ranked[:1]]
    near = [f for f in ranked[1:POLISHED_BEST] if _evidence(descent, f) > _evidence(descent, best[0]) - FAR_BELOW]
    with ThreadPoolExecutor(THREADS) as pool:
        return [*best, *pool.map(descent.polished, near), *ranked[1 + len(near) :]]


def _no_worse_than_nested(descent: Descent, singles: Sequence[Fitted], pairs: Sequence[Fitted]) -> list[Fitted]:
    """A pair must not win because its parts were fitted badly: each part of the best pair is fitted again from where the pair stands."""
    if not pairs:
        return list(singles)
    best = max(pairs, key=lambda pair: _evidence(descent, pair))
    parts = [part for number in range(2) if (part := _without(descent, best, number)) is not None]
    kept = {fitted.coordinates.choices: fitted for fitted in singles}
    for part in parts:
        again = descent.descended(part)
        if _evidence(descent, again) > _evidence(descent, best) - FAR_BELOW:
            again = descent.polished(again)
        before = kept.get(again.coordinates.choices)
        if before is None or _evidence(descent, again) > _evidence(descent, before):
            kept[again.coordinates.choices] = again
    return list(kept.values())


def _without(descent: Descent, pair: Fitted, number: int) -> Fitted | None:
    coordinates = pair.coordinates
    kept = [choice for i, choice in enumerate(coordinates.choices) if i != number]
    drop = np.arange(coordinates.size)[coordinates.part(number)]
    return descent.at(coordinates.with_choices(kept), np.delete(pair.x, drop), np.delete(pair.slope, drop, axis=1))


def _promising(descent: Descent, base: Fitted, trials: Iterable[Trial], count: int, starts: int) -> list[list[Trial]]:
    """For the effects that could take away most of the misfit, the best places to begin from."""
    measured = descent.evidence.rows.measured
    projection = projection_of(base, measured, descent.judge.level(base.linear(measured)))
    gains: dict[tuple[str, tuple[tuple[str, float], ...]], list[tuple[float, Trial]]] = {}
    for trial in trials:
        gains.setdefault((trial.choice.effect.id, trial.choice.whole), []).append((projection.gain(trial.signature)[0], trial))
    ranked = [sorted(group, key=lambda pair: -pair[0]) for group in gains.values()]
    ranked = sorted((group for group in ranked if group[0][0] > WORTH_A_FIT), key=lambda group: -group[0][0])
    return [[trial for gain, trial in group[:starts] if gain >= 0.5 * group[0][0]] for group in ranked[:count]]


def _refined(descent: Descent, base: Fitted, groups: Sequence[Sequence[Trial]]) -> list[Fitted]:
    with ThreadPoolExecutor(THREADS) as pool:
        found = list(pool.map(lambda group: _best_of(descent, base, group), groups))
    return [fitted for fitted in found if fitted is not None]


def _best_of(descent: Descent, base: Fitted, group: Sequence[Trial]) -> Fitted | None:
    """A few steps from every start, and all the way from where they led furthest."""
    begun = [begin for trial in group if (begin := _begun(descent, base, trial)) is not None]
    best = max(begun, key=lambda begin: _evidence(descent, begin), default=None)
    return None if best is None else descent.descended(best)


def _begun(descent: Descent, base: Fitted, trial: Trial) -> Fitted | None:
    """The base with one effect more, some steps down from where the trial has it."""
    wider = base.coordinates.with_choices((*base.coordinates.choices, trial.choice))
    start = descent.at(wider, np.concatenate([base.x, trial.z]), base.slope)
    return None if start is None else descent.descended(start, levels=2, rounds=2)


def _evidence(descent: Descent, fitted: Fitted) -> float:
    return _judged(descent, fitted).log_evidence


def _judged(descent: Descent, fitted: Fitted) -> Judgement:
    return descent.judge.judged(fitted.linear(descent.evidence.rows.measured))


def _pairs(descent: Descent, base: Fitted, singles: Sequence[Fitted], trials: Sequence[Trial]) -> list[Fitted]:
    """Partners for the best effects, screened by what they would do to a leg that has the first one already.

    Where nothing is missing, or one effect leaves no more than a good model does, none is sought.
    """
    judged = sorted(((_judged(descent, single), single) for single in singles), key=lambda pair: -pair[0].log_evidence)
    nothing = _judged(descent, base)
    if not judged or any(fits_well(found, base.coordinates.nuisances) for found in (nothing, judged[0][0])):
        return []
    found: dict[frozenset[str], Fitted] = {}
    for judgement, single in judged[:BUILT_ON]:
        if judgement.log_evidence < judged[0][0].log_evidence - HOPELESS:
            break
        own = _ids(single)
        others = {(t.choice.effect.id, t.choice.whole): t.choice for t in trials if t.choice.effect.id not in own}
        groups = _promising(descent, single, tried(descent.evidence, single, list(others.values())), PARTNERS, 1)
        new = [group for group in groups if frozenset((*own, group[0].choice.effect.id)) not in found]
        for pair in _refined(descent, single, new):
            found[frozenset(_ids(pair))] = pair
    return list(found.values())


def fits_well(judgement: Judgement, nuisances: int) -> bool:
    """Whether a hypothesis leaves no more than a good model does, all nuisances near where they are believed."""
    return judgement.error < GOOD_FIT and float(np.abs(judgement.posterior.mean[:nuisances]).max()) < STRAINED


def _ids(fitted: Fitted) -> tuple[str, ...]:
    return tuple(choice.effect.id for choice in fitted.coordinates.choices)


def _weighed(descent: Descent, base: Fitted, fits: Sequence[Fitted], trials: Sequence[Trial], scatter: Scatter, effects: int) -> Found:
    measured = descent.evidence.rows.measured
    nothing = Hypothesis((), base, descent.judge.judged(base.linear(measured)), float(np.log(PRIOR_NOTHING)))
    named = [Hypothesis(_ids(f), f, descent.judge.judged(f.linear(measured)), _log_prior(f, effects)) for f in fits]
    unknown = descent.judge.judged_unknown(base.linear(measured))
    ranked = tuple(sorted(named, key=lambda hypothesis: -hypothesis.log_joint))
    return Found(base, nothing, unknown, ranked, tuple(trials), scatter, descent.judge, descent.evidence)


def _log_prior(fitted: Fitted, effects: int) -> float:
    """Each number of effects has its share, spread evenly; so is what an effect counts, as which hinge."""
    choices = fitted.coordinates.choices
    share = PRIOR_ONE / effects if len(choices) == 1 else PRIOR_TWO / (0.5 * effects * (effects - 1))
    variants = np.prod([len(choices_of(choice.effect)) for choice in choices])
    return float(np.log(share / variants))
