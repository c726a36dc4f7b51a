"""What to put beside a fit: the effects that could take away most of its misfit, each brought from its best start to where it fits best."""

from collections.abc import Iterable, Sequence
from concurrent.futures import ThreadPoolExecutor

import numpy as np
from numpy.typing import NDArray

from rfca_rig.diagnosis.data.dataset import THREADS
from rfca_rig.diagnosis.inference.map_fit import GaussNewton, MapFit
from rfca_rig.diagnosis.inference.screening import EffectProbe, projection_of
from rfca_rig.diagnosis.likelihood.marginal_likelihood import STRAINED

Floats = NDArray[np.float64]

STARTS = 2  # places per effect to begin from, where the second promises half of the first
WORTH_A_FIT = 6.0  # chi2 that an effect must promise to take away, or it cannot pay for its parameters
DOES_THE_SAME = 0.9  # cosine of an effect and a nuisance


def worth_trying(
    descent: GaussNewton, fitted: MapFit, looks: Sequence[EffectProbe], count: int, least: float = WORTH_A_FIT
) -> list[list[EffectProbe]]:
    """The effects to put beside what was fitted, with the places to begin from: those that promise most, `least` of chi2 or more, and
    the one that a strain may stand for.
    """
    promising, relieving = _promising(descent, fitted, looks, count, least), relieving_of(descent, fitted, looks)
    tried_anyhow = {group[0].choice for group in promising}
    return [*promising, *(group for group in relieving if group[0].choice not in tried_anyhow)]


def _promising(descent: GaussNewton, base: MapFit, trials: Iterable[EffectProbe], count: int, least: float) -> list[list[EffectProbe]]:
    """For the effects that could take away most of the misfit, the best places to begin from."""
    measured = descent.evidence.rows.measured
    projection = projection_of(base, measured, descent.judge.level(base.linear(measured)))
    gains: dict[tuple[str, tuple[tuple[str, float], ...]], list[tuple[float, EffectProbe]]] = {}
    for trial in trials:
        gains.setdefault((trial.choice.effect.id, trial.choice.whole), []).append((projection.gain(trial.signature)[0], trial))
    ranked = [sorted(group, key=lambda pair: -pair[0]) for group in gains.values()]
    ranked = sorted((group for group in ranked if group[0][0] > least), key=lambda group: -group[0][0])
    return [_starting(group) for group in ranked[:count]]


def _starting(ranked: Sequence[tuple[float, EffectProbe]]) -> list[EffectProbe]:
    """The best places of one effect; more where steps from one lead to few others."""
    return [trial for gain, trial in ranked[: 2 * STARTS if _is_rugged(ranked[0][1]) else STARTS] if gain >= 0.5 * ranked[0][0]]


def _is_rugged(trial: EffectProbe) -> bool:
    return any(parameter.starts for parameter in trial.choice.effect.parameters)


def optimize(descent: GaussNewton, base: MapFit, groups: Sequence[Sequence[EffectProbe]]) -> list[MapFit]:
    """Each effect, from the best of its starts, where it fits best beside what the base has."""
    bases = [base, *_as_believed(descent, base)]
    with ThreadPoolExecutor(THREADS) as pool:
        found = list(pool.map(lambda group: _best_of(descent, bases, group), groups))
    return [fitted for fitted in found if fitted is not None]


def _as_believed(descent: GaussNewton, base: MapFit) -> list[MapFit]:
    """The base with all nuisances where they are believed, if they had to go far: what is missing may have drawn them there."""
    if base.farthest < STRAINED:
        return []
    there = descent.at(base.coordinates, base.as_believed)
    return [] if there is None else [there]


def _best_of(descent: GaussNewton, bases: Sequence[MapFit], group: Sequence[EffectProbe]) -> MapFit | None:
    """A few steps from every start, and all the way from where they led furthest, or from two such places where steps lead astray."""
    rugged = _is_rugged(group[0])
    places = [(base, trial) for base in bases for trial in (group if rugged or base is bases[0] else group[:1])]
    begun = [begin for base, trial in places if (begin := _begun(descent, base, trial)) is not None]
    best = sorted(begun, key=descent.log_evidence, reverse=True)[: 2 if rugged else 1]
    return max((descent.refine(begin) for begin in best), key=descent.log_evidence, default=None)


def _begun(descent: GaussNewton, base: MapFit, trial: EffectProbe) -> MapFit | None:
    """The base with one effect more, some steps down from where the trial has it."""
    wider = base.coordinates.with_terms((*base.coordinates.choices, trial.choice))
    start = descent.at(wider, np.concatenate([base.x, trial.z]), base.jacobian)
    return None if start is None else descent.refine(start, levels=2, rounds=2)


def relieving_of(descent: GaussNewton, fitted: MapFit, looks: Sequence[EffectProbe]) -> list[list[EffectProbe]]:
    """The effect that does what the most strained nuisance does, if there is one: a rack 3 mm too high is no rack known to 0.2 mm."""
    moved = descent.evaluate(fitted).posterior.mean[: fitted.coordinates.nuisances]
    worst = int(np.argmax(np.abs(moved)))
    if abs(moved[worst]) < STRAINED:
        return []
    does = fitted.jacobian[:, worst]
    same = [look for look in looks if look.choice.effect.same_as == fitted.coordinates.space.names[worst]]
    if same:
        return [[min(same, key=lambda look: float(np.linalg.norm(descent.judge.usual(look.signature - does * moved[worst]))))]]
    wanted = _direction(descent, does)
    alike = sorted(((abs(float(_direction(descent, look.signature) @ wanted)), n) for n, look in enumerate(looks)), reverse=True)
    return [[looks[n]] for cosine, n in alike[:1] if cosine > DOES_THE_SAME]


def _direction(descent: GaussNewton, rows: Floats) -> Floats:
    white = descent.judge.usual(rows)
    return np.asarray(white / max(float(np.linalg.norm(white)), 1e-300))
