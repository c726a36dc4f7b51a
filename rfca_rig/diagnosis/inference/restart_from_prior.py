"""A second look, where the best explanation so far is none: effects and pairs of them begun from the values that are believed.

What is missing may have drawn the nuisances so far away that the effects found first are those that excuse them, and no search that
builds on these comes back.
"""

from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import cached_property
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from rfca_rig.diagnosis.data.dataset import THREADS, Dataset
from rfca_rig.diagnosis.inference.map_fit import GaussNewton, MapFit
from rfca_rig.diagnosis.inference.nuisance_swap import resized
from rfca_rig.diagnosis.inference.parameterization import FARTHEST, EffectTerm
from rfca_rig.diagnosis.inference.screening import RESCALED, EffectProbe, Projection, probe_effects, projection_of
from rfca_rig.diagnosis.likelihood.cross_validation import MAX_LOO_RMS, loo_rms
from rfca_rig.diagnosis.likelihood.marginal_likelihood import IMPLAUSIBLE

Floats = NDArray[np.float64]
Promising = Callable[[Projection, Sequence[EffectProbe]], list[tuple[EffectProbe, ...]]]

MOST = 6  # effects, or pairs of them, that are fitted, of those that promise most
WORTH_A_PAIR = 0.1  # of the misfit, that two effects must promise to take away: those that explain promise a third of it and more
LOST_BY = 0.25  # log evidence for each row by which something unlisted is likelier than a fit that explains next to nothing


@dataclass(frozen=True)
class NominalFit:
    """The model as believed, and what each of the `choices` would do to it; `looked` where that was looked at already.

    How static tables were moved through may have been learnt since: what an effect does hardly hangs on it.
    """

    fitted: MapFit
    evidence: Dataset
    choices: tuple[EffectTerm, ...]
    looked: tuple[EffectProbe, ...] = ()

    @cached_property
    def trials(self) -> Sequence[EffectProbe]:
        return self.looked or probe_effects(self.evidence, self.fitted, self.choices)


def fits_worse_than_unknown(descent: GaussNewton, fitted: MapFit) -> bool:
    """Whether a fit explains so little that it is no place to go on from."""
    return descent.evaluate_unlisted(fitted).log_evidence > descent.log_evidence(fitted) + LOST_BY * len(descent.evidence.rows.measured)


def nuisances_out_of_range(descent: GaussNewton, base: MapFit) -> bool:
    """Whether the fit without effects would have its nuisances farther away than any descent goes."""
    return descent.evaluate(base).farthest(base.coordinates.nuisances) > FARTHEST


def is_adequate(descent: GaussNewton, fitted: MapFit) -> bool:
    """Whether something unlisted is no likelier, nothing that is believed had to go, and conditions are foretold from each other."""
    rows, judgement = descent.evidence.rows, descent.evaluate(fitted)
    unlisted = descent.evaluate_unlisted(fitted).log_evidence
    if judgement.farthest(fitted.coordinates.nuisances) > IMPLAUSIBLE or unlisted > judgement.log_evidence:
        return False
    apart = loo_rms(fitted.linear(rows.measured), descent.judge.usual, rows)
    return len(apart) < 2 or float(apart.mean()) <= MAX_LOO_RMS


def singles_from_belief(descent: GaussNewton, belief: NominalFit) -> list[MapFit]:
    """The effects that promise most beside the nuisances as believed, each where it fits best from there."""
    return _from_belief(descent, belief, _promising_alone)


def pairs_from_belief(descent: GaussNewton, belief: NominalFit) -> list[MapFit]:
    """The same for pairs of effects that promise most together."""
    return _from_belief(descent, belief, _promising_together)


def _from_belief(descent: GaussNewton, belief: NominalFit, promising: Promising) -> list[MapFit]:
    fitted = belief.fitted
    believed = descent.at(fitted.coordinates, fitted.x, fitted.jacobian)
    if believed is None or not belief.trials:
        return []
    measured = descent.evidence.rows.measured
    projection = projection_of(believed, measured, descent.judge.level(believed.linear(measured)))
    groups = promising(projection, belief.trials)
    with ThreadPoolExecutor(THREADS) as pool:
        found = list(pool.map(lambda group: _fitted(descent, believed, group), groups[:MOST]))
    return [fitted for fitted in found if fitted is not None]


def _fitted(descent: GaussNewton, believed: MapFit, group: Sequence[EffectProbe]) -> MapFit | None:
    """The effects as large as fits best with the nuisances as believed, and all the way down from there."""
    wider = believed.coordinates.with_terms((*believed.coordinates.choices, *(trial.choice for trial in group)))
    begin = descent.at(wider, np.concatenate([believed.x, *(trial.z for trial in group)]), believed.jacobian)
    begin = None if begin is None else resized(descent, begin, np.ones(wider.nuisances, dtype=bool))
    return None if begin is None else descent.refine(begin)


def _promising_alone(projection: Projection, trials: Sequence[EffectProbe]) -> list[tuple[EffectProbe, ...]]:
    """The best trial of each effect, most promising first."""
    ranked = sorted(trials, key=lambda trial: projection.gain(trial.signature)[0])
    best = {trial.choice.effect.id: trial for trial in ranked}
    return [(trial,) for trial in ranked[::-1] if best[trial.choice.effect.id] is trial]


def _promising_together(projection: Projection, trials: Sequence[EffectProbe]) -> list[tuple[EffectProbe, ...]]:
    """The best two trials of each pair of effects that is worth a fit, most promising first."""
    gain = _gains(projection, trials)
    least = WORTH_A_PAIR * float(projection.residual @ projection.residual)
    best: dict[frozenset[str], tuple[float, int, int]] = {}
    for i, j in combinations(range(len(trials)), 2):
        pair = frozenset((trials[i].choice.effect.id, trials[j].choice.effect.id))
        if len(pair) == 2 and gain[i, j] > best.get(pair, (least, 0, 0))[0]:
            best[pair] = (float(gain[i, j]), i, j)
    return [(trials[i], trials[j]) for _, i, j in sorted(best.values(), reverse=True)]


def _gains(projection: Projection, trials: Sequence[EffectProbe]) -> Floats:
    """The chi2 that trials i and j could take away together, each scaled as suits, (k, k)."""
    white = projection.whitening(np.column_stack([trial.signature for trial in trials]))
    gram, match = white.T @ projection.through(white), white.T @ projection.residual
    own, shared = np.diag(gram), gram**2
    det = np.maximum(np.outer(own, own) - shared, 1e-9 * np.outer(own, own) + 1e-300)
    first = np.clip((np.outer(match, own) - gram * match[None, :]) / det, 0.0, RESCALED)
    second = first.T
    quadratic = first**2 * own[:, None] + 2.0 * first * second * gram + second**2 * own[None, :]
    return np.asarray(2.0 * (first * match[:, None] + second * match[None, :]) - quadratic)
