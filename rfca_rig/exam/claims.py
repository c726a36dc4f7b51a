"""How far to trust probabilities and values: calibration of claims, errors of parameters."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rfca_rig.exam.answer import Claim, Said
from rfca_rig.exam.outcome import Truth
from rfca_rig.exam.sizes import SPANS

Array = NDArray[Any]

BINS = 10
CONFIDENT = 0.9
SMALLEST = 1e-3  # a probability of 0 or 1 that turns out wrong counts as this, in the logarithmic score
NINETY_PERCENT = 1.645  # standard deviations on either side
WHOLE_NUMBERS = ("hinge",)

Judged = Sequence[tuple[Truth, Said]]


@dataclass(frozen=True)
class ClaimCalibration:
    """Of all listed claims; what is there and was not listed had no probability stated, and counts where effects are counted. NaN where
    there is none.

    `bins` (10 x 3): number of claims, their mean probability, share of them right.
    """

    brier: float
    log_score: float
    ece: float
    confident: int
    confident_right: float
    bins: tuple[tuple[int, float, float], ...]


@dataclass(frozen=True)
class Values:
    """Over the parameters of rightly named effects; shares of 1."""

    count: int
    median_error: float
    coverage_90: float


def calibration(judged: Judged) -> ClaimCalibration:
    """Brier and logarithmic score, expected calibration error, and how many of the claims at 90 % and more are right."""
    p, hit = _claims(judged)
    if not len(p):
        return ClaimCalibration(np.nan, np.nan, np.nan, 0, np.nan, ())
    bounded = np.clip(p, SMALLEST, 1.0 - SMALLEST)
    sure = p >= CONFIDENT
    bins = _bins(p, hit)
    return ClaimCalibration(
        brier=float(((p - hit) ** 2).mean()),
        log_score=float(-np.where(hit, np.log(bounded), np.log(1.0 - bounded)).mean()),
        ece=float(sum(n * abs(mean - right) for n, mean, right in bins if n) / len(p)),
        confident=int(sure.sum()),
        confident_right=float(hit[sure].mean()) if sure.any() else np.nan,
        bins=bins,
    )


def _claims(judged: Judged) -> tuple[Array, Array]:
    pairs: list[tuple[float, bool]] = []
    for truth, said in judged:
        true = set(truth.effects) | truth.accepted
        pairs += [(claim.probability, bool(claim.members & true)) for claim in said.claims]
    p, hit = zip(*pairs, strict=True) if pairs else ((), ())
    return np.array(p, dtype=float), np.array(hit, dtype=bool)


def _bins(p: Array, hit: Array) -> tuple[tuple[int, float, float], ...]:
    place = np.minimum((p * BINS).astype(int), BINS - 1)
    inside = [place == b for b in range(BINS)]
    return tuple((int(i.sum()), float(p[i].mean()), float(hit[i].mean())) if i.any() else (0, np.nan, np.nan) for i in inside)


def calibration_error(probability: Array, true: Array, least: float = 0.0, bins: int = BINS) -> float:
    """Expected calibration error over equal bins of the probability from `least` to 1 (Naeini et al., AAAI 2015)."""
    place = np.minimum(((probability - least) / (1.0 - least) * bins).astype(int), bins - 1)
    return float(sum(abs(probability[place == b].sum() - true[place == b].sum()) for b in range(bins)) / len(true))


def values(judged: Judged) -> Values:
    """Errors of the parameters of effects named by their own id, where the catalogue's law is the true one."""
    found = [each for truth, said in judged if not truth.lawless for claim in said.named for each in parameter_errors(truth, claim)]
    if not found:
        return Values(0, np.nan, np.nan)
    errors, covered = zip(*found, strict=True)
    inside = [each for each in covered if each is not None]
    return Values(len(errors), float(np.median(errors)), float(np.mean(inside)) if inside else np.nan)


def parameter_errors(truth: Truth, claim: Claim) -> list[tuple[float, bool | None]]:
    """(relative error, inside the 90 % interval or not) of each parameter of a claim; empty for a claim that is not true.

    Relative to what the effect changes: a gain of 1.03 found as 1.02 is off by a third. A whole number is right or wrong.
    """
    true = truth.effects.get(claim.id, {})
    return [_error(claim.id, name, true[name], value) for name, value in claim.parameters.items() if name in true]


def _error(effect: str, name: str, true: float, found: tuple[float, float]) -> tuple[float, bool | None]:
    value, std = found
    if name in WHOLE_NUMBERS:
        return float(round(value) != round(true)), None
    span = SPANS.get(effect, {}).get(name)
    size = abs(true - (span.around if span else 0.0))
    return abs(value - true) / size, abs(value - true) <= NINETY_PERCENT * std
