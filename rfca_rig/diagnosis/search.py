"""All hypotheses that matter: nothing missing, something unlisted, each effect, and pairs that build on the best effects."""

from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from rfca_rig.diagnosis.conventions import held_anyhow, with_likeliest_moves
from rfca_rig.diagnosis.coordinates import Coordinates
from rfca_rig.diagnosis.descent import Descent, Fitted
from rfca_rig.diagnosis.evidence import THREADS, Evidence
from rfca_rig.diagnosis.handing_over import STRAINED, handed_over
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
GOOD_FIT = 0.011  # a model error below which no further effect is sought, unless a nuisance is strained
BUILT_ON = 2  # effects that pairs are built on
PARTNERS = 4  # partners refined for each
DOES_THE_SAME = 0.9  # cosine of an effect and a nuisance
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


def searched(
    evidence: Evidence, coordinates: Coordinates, effects: Sequence[Effect], progress: Progress, stopped_as_told: bool = True
) -> Found:
    """The search over these effects and their pairs; `stopped_as_told` says whether the shaft stood where it was told in static stages.

    Raises SimulationFailed where the model cannot be computed as believed.
    """
    progress("nothing missing", 0.0)
    loose = held_anyhow(evidence)
    start = Descent(loose, judge_of(loose.rows, np.empty((len(loose.rows.measured), 0))))
    believed = start.at(coordinates, np.zeros(coordinates.size))
    if believed is None:
        raise SimulationFailed("the model cannot be computed as believed; look for a slipped decimal point in the leg or the ground")
    base = start.descended(believed)
    scatter = scatter_of(loose, coordinates.supposed(base.x))
    descent = Descent(loose, judge_of(loose.rows, scatter.columns))
    base = descent.polished(base)
    progress("a first look at every effect", 0.1)
    trials = tried(loose, base, [choice for effect in effects for choice in choices_of(effect)])
    progress("each effect", 0.3)
    singles = _refined(descent, base, _promising(descent, base, trials, REFINED, STARTS))
    # what scatters acts through the leg and drive as they are, and how a static table was moved through shows in how its tip was held:
    # both are learnt anew from the best explanation so far
    best = _clearly_better(descent, base, singles) or base
    moved = with_likeliest_moves(loose, best.coordinates, best.x, stopped_as_told)
    if best is not base or moved is not loose:
        scatter = scatter_of(moved, best.coordinates.supposed(best.x))
        descent = Descent(moved, judge_of(moved.rows, scatter.columns))
        base, *singles = (_carried_on(descent, fitted) for fitted in (base, *singles))
    singles = _best_polished(descent, singles)
    base = _polished_if_near(descent, base, singles)
    progress("pairs of effects", 0.6)
    pairs = _best_polished(descent, _pairs(descent, base, singles, trials))
    progress("weighing", 0.9)
    singles = _no_worse_than_nested(descent, singles, pairs)
    found = _weighed(descent, base, [*singles, *pairs], trials, scatter, len(effects))
    return replace(found, believed=descent.at(coordinates, believed.x, believed.slope) or believed)


def _carried_on(descent: Descent, fitted: Fitted) -> Fitted:
    """A fit to other evidence, fitted to this from where it stands; as it was where the model has no answer there."""
    here = descent.at(fitted.coordinates, fitted.x, fitted.slope)
    return fitted if here is None else descent.descended(here)


def _polished_if_near(descent: Descent, base: Fitted, singles: Sequence[Fitted]) -> Fitted:
    best = max((_evidence(descent, single) for single in singles), default=-np.inf)
    return descent.polished(base) if _evidence(descent, base) > best - FAR_BELOW else base


def _clearly_better(descent: Descent, base: Fitted, singles: Sequence[Fitted]) -> Fitted | None:
    """The best of them, if it leaves the base far behind."""
    best = max(singles, key=lambda single: _evidence(descent, single), default=None)
    return None if best is None or _evidence(descent, best) < _evidence(descent, base) + CLEARLY_BETTER else best


def _best_polished(descent: Descent, fits: Sequence[Fitted]) -> list[Fitted]:
    """The likeliest at its very best point, and those few that come near it; the others stay as they are, far below."""
    ranked = sorted(fits, key=lambda fitted: -_evidence(descent, fitted))
    best = [handed_over(descent, _from_belief_too(descent, descent.polished(fitted))) for fitted in ranked[:1]]
    near = [f for f in ranked[1:POLISHED_BEST] if _evidence(descent, f) > _evidence(descent, best[0]) - FAR_BELOW]
    with ThreadPoolExecutor(THREADS) as pool:
        polished = list(pool.map(descent.polished, near))
    return [*best, *(handed_over(descent, fitted) for fitted in polished), *ranked[1 + len(near) :]]


def _from_belief_too(descent: Descent, found: Fitted) -> Fitted:
    """The better of what was found and of where its effects lead when the nuisances begin once more as believed; where it fits, that."""
    if descent.judged(found).error < GOOD_FIT:
        return found
    again = [descent.polished(descent.descended(begin)) for begin in _as_believed(descent, found)]
    return max((found, *again), key=lambda fitted: _evidence(descent, fitted))


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
    return [_starting(group, starts) for group in ranked[:count]]


def _starting(ranked: Sequence[tuple[float, Trial]], starts: int) -> list[Trial]:
    """The best places of one effect; more where steps from one lead to few others."""
    return [trial for gain, trial in ranked[: 2 * starts if _is_rugged(ranked[0][1]) else starts] if gain >= 0.5 * ranked[0][0]]


def _is_rugged(trial: Trial) -> bool:
    return any(parameter.starts for parameter in trial.choice.effect.parameters)


def _refined(descent: Descent, base: Fitted, groups: Sequence[Sequence[Trial]]) -> list[Fitted]:
    bases = [base, *_as_believed(descent, base)]
    with ThreadPoolExecutor(THREADS) as pool:
        found = list(pool.map(lambda group: _best_of(descent, bases, group), groups))
    return [fitted for fitted in found if fitted is not None]


def _as_believed(descent: Descent, base: Fitted) -> list[Fitted]:
    """The base with all nuisances where they are believed, if they had to go far: what is missing may have drawn them there."""
    nuisances = base.coordinates.nuisances
    if float(np.abs(base.x[:nuisances]).max()) < STRAINED:
        return []
    x = np.concatenate([np.zeros(nuisances), base.x[nuisances:]])
    there = descent.at(base.coordinates, x, base.slope)
    return [] if there is None else [there]


def _best_of(descent: Descent, bases: Sequence[Fitted], group: Sequence[Trial]) -> Fitted | None:
    """A few steps from every start, and all the way from where they led furthest, or from two such places where steps lead astray."""
    rugged = _is_rugged(group[0])
    places = [(base, trial) for base in bases for trial in (group if rugged or base is bases[0] else group[:1])]
    begun = [begin for base, trial in places if (begin := _begun(descent, base, trial)) is not None]
    best = sorted(begun, key=lambda begin: -_evidence(descent, begin))[: 2 if rugged else 1]
    return max((descent.descended(begin) for begin in best), key=lambda found: _evidence(descent, found), default=None)


def _begun(descent: Descent, base: Fitted, trial: Trial) -> Fitted | None:
    """The base with one effect more, some steps down from where the trial has it."""
    wider = base.coordinates.with_choices((*base.coordinates.choices, trial.choice))
    start = descent.at(wider, np.concatenate([base.x, trial.z]), base.slope)
    return None if start is None else descent.descended(start, levels=2, rounds=2)


def _evidence(descent: Descent, fitted: Fitted) -> float:
    return descent.judged(fitted).log_evidence


def _pairs(descent: Descent, base: Fitted, singles: Sequence[Fitted], trials: Sequence[Trial]) -> list[Fitted]:
    """Partners for the best effects, screened by what they would do to a leg that has the first one already.

    Where nothing is missing, or one effect leaves no more than a good model does, none is sought.
    """
    judged = sorted(((descent.judged(single), single) for single in singles), key=lambda pair: -pair[0].log_evidence)
    nothing = descent.judged(base)
    if not judged or any(fits_well(found, base.coordinates.nuisances) for found in (nothing, judged[0][0])):
        return []
    found: dict[frozenset[str], Fitted] = {}
    for judgement, single in judged[:BUILT_ON]:
        if judgement.log_evidence < judged[0][0].log_evidence - HOPELESS:
            break
        own = _ids(single)
        others = {(t.choice.effect.id, t.choice.whole): t.choice for t in trials if t.choice.effect.id not in own}
        looks = tried(descent.evidence, single, list(others.values()))
        groups = [*_promising(descent, single, looks, PARTNERS, STARTS), *_relieving(descent, single, judgement, looks)]
        new = {frozenset((*own, group[0].choice.effect.id)): group for group in reversed(groups)}
        for pair in _refined(descent, single, [group for ids, group in new.items() if ids not in found]):
            found[frozenset(_ids(pair))] = pair
    return list(found.values())


def _relieving(descent: Descent, single: Fitted, judgement: Judgement, looks: Sequence[Trial]) -> list[list[Trial]]:
    """The effect that does what the most strained nuisance does, if there is one: a rack 3 mm too high is no rack known to 0.2 mm."""
    moved = judgement.posterior.mean[: single.coordinates.nuisances]
    worst = int(np.argmax(np.abs(moved)))
    if abs(moved[worst]) < STRAINED:
        return []
    wanted = _direction(descent, single.slope[:, worst])
    alike = sorted(((abs(float(_direction(descent, look.signature) @ wanted)), n) for n, look in enumerate(looks)), reverse=True)
    return [[looks[n]] for cosine, n in alike[:1] if cosine > DOES_THE_SAME]


def _direction(descent: Descent, rows: Floats) -> Floats:
    white = descent.judge.usual(rows)
    return np.asarray(white / max(float(np.linalg.norm(white)), 1e-300))


def fits_well(judgement: Judgement, nuisances: int) -> bool:
    """Whether a hypothesis leaves no more than a good model does, all nuisances near where they are believed."""
    return judgement.error < GOOD_FIT and float(np.abs(judgement.posterior.mean[:nuisances]).max()) < STRAINED


def _ids(fitted: Fitted) -> tuple[str, ...]:
    return tuple(choice.effect.id for choice in fitted.coordinates.choices)


def _weighed(descent: Descent, base: Fitted, fits: Sequence[Fitted], trials: Sequence[Trial], scatter: Scatter, effects: int) -> Found:
    measured = descent.evidence.rows.measured
    nothing = Hypothesis((), base, descent.judged(base), float(np.log(PRIOR_NOTHING)))
    named = [Hypothesis(_ids(f), f, descent.judged(f), _log_prior(f, effects)) for f in fits]
    unknown = descent.judge.judged_unknown(base.linear(measured))
    ranked = tuple(sorted(named, key=lambda hypothesis: -hypothesis.log_joint))
    return Found(base, nothing, unknown, ranked, tuple(trials), scatter, descent.judge, descent.evidence)


def _log_prior(fitted: Fitted, effects: int) -> float:
    """Each number of effects has its share, spread evenly; so is what an effect counts, as which hinge."""
    choices = fitted.coordinates.choices
    share = PRIOR_ONE / effects if len(choices) == 1 else PRIOR_TWO / (0.5 * effects * (effects - 1))
    variants = np.prod([len(choices_of(choice.effect)) for choice in choices])
    return float(np.log(share / variants))
