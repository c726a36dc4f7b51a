"""What a strained nuisance does, handed over to an effect that does the same.

A soft floor and a contact softer than believed push alike; along such a ridge only the prior says where to stand, and its slope is lost in
the roughness of a model with touchdowns in it. A descent that came from the nuisance's side stays there.
"""

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import partial

import numpy as np
from numpy.typing import NDArray

from rfca_rig.diagnosis.data.dataset import THREADS
from rfca_rig.diagnosis.inference.map_fit import GaussNewton, MapFit
from rfca_rig.diagnosis.inference.parameterization import Parameterization
from rfca_rig.diagnosis.likelihood.covariance import Whitening
from rfca_rig.diagnosis.likelihood.marginal_likelihood import IMPLAUSIBLE, STRAINED

Floats = NDArray[np.float64]

COARSE = tuple(np.linspace(-2.0, 2.0, 9))  # sizes of an effect's coordinate,
FINE = tuple(np.linspace(-0.4, 0.4, 9))  # and steps from the best of them: a stop is at its place to a tenth, or nowhere
AT_MOST = 2  # nuisances, one after the other
MAY_GAIN = 50.0  # log evidence that the last steps may bring
AS_LIKELY = 10.0  # log evidence that a law which is not quite the real one costs or brings along such a ridge
NEARER = 0.5  # prior deviations


def swap_nuisance(descent: GaussNewton, found: MapFit) -> MapFit:
    """The better of `found` and of where its effects lead when its most strained nuisance, or all of them, begin as believed.

    As it was found where none of its effects does what a believed value does: nothing is there to be handed over.
    """
    if not any(found.coordinates.same_as):
        return found
    for _ in range(AT_MOST):
        if found.farthest < STRAINED:
            return found
        x = np.abs(found.x[: found.coordinates.nuisances])
        again = _led_elsewhere(descent, found, (x == found.farthest, np.ones(len(x), dtype=bool)))
        if not _is_better(descent, again, found):
            return found
        found = again
    return found


def _is_better(descent: GaussNewton, again: MapFit, found: MapFit) -> bool:
    """Whether it is likelier; or all but as likely, with the worst nuisance clearly nearer to where it is believed."""
    gain = descent.log_evidence(again) - descent.log_evidence(found)
    nearer = again.farthest < found.farthest - NEARER
    return gain > (-AS_LIKELY if nearer else 0.0)


def _led_elsewhere(descent: GaussNewton, found: MapFit, resets: Sequence[NDArray[np.bool_]]) -> MapFit:
    """Where the effects lead from the better of these beginnings, at its very best point if that can come to what was found.

    Where what was found could not be claimed anyhow, all of them are first taken down with new slopes, whatever they promise.
    """
    begun = [begin for reset in resets if (begin := resized(descent, found, reset)) is not None]
    with ThreadPoolExecutor(THREADS) as pool:
        led = list(pool.map(descent.refine, begun))
        if found.farthest > IMPLAUSIBLE:
            led = list(pool.map(partial(descent.converge, rounds=1), led))
    best = max(led, key=descent.log_evidence, default=found)
    return descent.converge(best) if descent.log_evidence(best) > descent.log_evidence(found) - MAY_GAIN else best


def resized(descent: GaussNewton, found: MapFit, reset: NDArray[np.bool_]) -> MapFit | None:
    """These nuisances as believed, and the effects as large as then fits best; None without an effect, or where the model has no answer."""
    nuisances = found.coordinates.nuisances
    begin = np.concatenate([np.where(reset, 0.0, found.x[:nuisances]), found.x[nuisances:]])
    whitening = descent.judge.level(found.linear(descent.evidence.rows.measured))
    free = _sizes(found.coordinates)
    best = _best_of(descent, found, whitening, [_with(begin, place, size) for place in free for size in COARSE])
    if best is not None:
        best = _best_of(descent, found, whitening, [_with(best, place, best[place] + size) for place in free for size in FINE])
    return None if best is None else descent.at(found.coordinates, best)


def _sizes(coordinates: Parameterization) -> list[int]:
    """Where the parameters of the effects stand, but for how they begin."""
    return [
        coordinates.part(number).start + n
        for number, choice in enumerate(coordinates.choices)
        for n, parameter in enumerate(choice.free)
        if parameter in choice.sizes
    ]


def _best_of(descent: GaussNewton, found: MapFit, whitening: Whitening, places: Sequence[Floats]) -> Floats | None:
    predicted = descent.evidence.predicted_all([found.coordinates.supposed(x) for x in places])
    with_answer = [(x, rows) for x, rows in zip(places, predicted, strict=True) if rows is not None]
    best = min(with_answer, key=lambda pair: descent.misfit(pair[0], pair[1], whitening), default=None)
    return None if best is None else best[0]


def _with(x: Floats, place: int, size: float) -> Floats:
    there = x.copy()
    there[place] = size
    return there
