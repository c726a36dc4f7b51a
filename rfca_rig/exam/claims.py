"""Calibration of the claims' probabilities, and errors of the parameters of named effects."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rfca_rig.exam.answer import Claim, ParsedDiagnosis, Truth
from rfca_rig.exam.sizes import SIZE_RANGES

Array = NDArray[Any]

BINS = 10
CONFIDENT = 0.9
# In the logarithmic score, probabilities are clipped at this distance from 0 and 1: a wrong 0 or 1 would cost infinitely much.
PROBABILITY_FLOOR = 1e-3
# Half width of a normal 90 % interval, in standard deviations.
NINETY_PERCENT = 1.645
WHOLE_NUMBERS = ("hinge",)

Judged = Sequence[tuple[Truth, ParsedDiagnosis]]


@dataclass(frozen=True)
class ClaimCalibration:
    """Calibration of all listed claims; NaN where there is none.

    A true effect that was not listed has no stated probability; the counts of effects include it, these scores do not.
    `bins` (10, 3): number of claims, their mean probability, share of them right.
    """

    brier: float
    log_score: float
    ece: float
    confident: int
    confident_right: float
    bins: tuple[tuple[int, float, float], ...]


@dataclass(frozen=True)
class ParameterAccuracy:
    """Errors and coverage over the parameters of rightly named effects, as fractions of 1."""

    count: int
    median_error: float
    coverage_90: float


def calibration(judged: Judged) -> ClaimCalibration:
    """Brier and logarithmic score, expected calibration error, and the share of right claims among those at 90 % or more."""
    p, hit = _claims(judged)
    if not len(p):
        return ClaimCalibration(np.nan, np.nan, np.nan, 0, np.nan, ())
    bounded = np.clip(p, PROBABILITY_FLOOR, 1.0 - PROBABILITY_FLOOR)
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
    for truth, answer in judged:
        true = set(truth.effects) | truth.accepted
        pairs += [(claim.probability, bool(claim.members & true)) for claim in answer.claims]
    p, hit = zip(*pairs, strict=True) if pairs else ((), ())
    return np.array(p, dtype=float), np.array(hit, dtype=bool)


def _bins(p: Array, hit: Array) -> tuple[tuple[int, float, float], ...]:
    place = np.minimum((p * BINS).astype(int), BINS - 1)
    inside = [place == b for b in range(BINS)]
    return tuple((int(i.sum()), float(p[i].mean()), float(hit[i].mean())) if i.any() else (0, np.nan, np.nan) for i in inside)


def calibration_error(probability: Array, true: Array, least: float = 0.0, bins: int = BINS) -> float:
    """Expected calibration error over equal bins of the probability from `least` to 1.

    Parameters
    ----------
    probability, true : (n,) arrays
        Stated probabilities, all `least` or more, and whether each statement is true.
    least : float
        Lower end of the first bin.
    bins : int
        Number of bins.

    References
    ----------
    Naeini et al., AAAI 2015.
    """
    # A probability of exactly 1 belongs to the last bin.
    place = np.minimum(((probability - least) / (1.0 - least) * bins).astype(int), bins - 1)
    return float(sum(abs(probability[place == b].sum() - true[place == b].sum()) for b in range(bins)) / len(true))


def values(judged: Judged) -> ParameterAccuracy:
    """Errors of the parameters of effects that are named by their own id, in cases whose true law is the catalogue's."""
    found = [each for truth, answer in judged if not truth.lawless for claim in answer.named for each in parameter_errors(truth, claim)]
    if not found:
        return ParameterAccuracy(0, np.nan, np.nan)
    errors, covered = zip(*found, strict=True)
    inside = [each for each in covered if each is not None]
    return ParameterAccuracy(len(errors), float(np.median(errors)), float(np.mean(inside)) if inside else np.nan)


def parameter_errors(truth: Truth, claim: Claim) -> list[tuple[float, bool | None]]:
    """(relative error, whether the truth is inside the 90 % interval) of each parameter of a claim; empty for a false claim.

    Errors are relative to what the effect changes: a gain of 1.03 found as 1.02 is off by a third. A whole number is right or wrong.
    """
    true = truth.effects.get(claim.id, {})
    return [_error(claim.id, name, true[name], value) for name, value in claim.parameters.items() if name in true]


def _error(effect: str, name: str, true: float, found: tuple[float, float]) -> tuple[float, bool | None]:
    value, std = found
    if name in WHOLE_NUMBERS:
        return float(round(value) != round(true)), None
    span = SIZE_RANGES.get(effect, {}).get(name)
    size = abs(true - (span.around if span else 0.0))
    return abs(value - true) / size, abs(value - true) <= NINETY_PERCENT * std
