"""Calibration of the claims' probabilities, and errors of the parameters of named effects.

Scores of graded answers: whether each statement is true, whether sizes lie in their intervals,
whether a place is right.

A statement is an effect that is stated as identified or as most of what is missing, or a family
where no effect is stated. An effect is true if the case hides it, or an effect of its
indistinguishable set. A family is true if the case hides a member, or an effect outside the
catalogue that belongs to it.
"""

from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rfca_rig.exam import cases
from rfca_rig.exam.answer import DETECTABLE, Claim, ParsedDiagnosis, Truth
from rfca_rig.exam.cases import SIZE_RANGES
from rfca_rig.exam.pendulums.cases import PENDULUM_NOTHING, PENDULUM_SINGLE
from rfca_rig.model.catalogue import families_of, members_of

Array = NDArray[Any]

BINS = 10
CONFIDENT = 0.9
# In the logarithmic score, probabilities are clipped at this distance from 0 and 1: a wrong 0 or 1
# would cost infinitely much.
PROBABILITY_FLOOR = 1e-3
# Half width of a normal 90 % interval, in standard deviations.
NINETY_PERCENT = 1.645
WHOLE_NUMBERS = ("hinge",)

Judged = Sequence[tuple[Truth, ParsedDiagnosis]]

# Stated probability from which a wrong statement counts.
SURE_PROBABILITY = 0.8
# Lower probabilities lead to no statement, so their calibration is not scored.
MIN_PROBABILITY = 0.3
STATEMENT_BINS = 7

NULL_KINDS = (cases.NOTHING, cases.MODEL_ERROR, PENDULUM_NOTHING)
SINGLE_KINDS = (cases.SINGLE, PENDULUM_SINGLE)

# Of each effect outside the catalogue: the families it belongs to, and the part of the rig where it
# acts.
STRANGERS: Mapping[str, tuple[tuple[str, ...], str]] = {
    "force_cogging": ((), "sensor"),
    "hinge_asymmetry": (("hinge_stiffness",), "hinges"),
    "floor_magnet": (("floor_holds",), "ground"),
    "friction_by_direction": (("floor_friction",), "ground"),
    "sensor_curvature": (("sensor_scale",), "sensor"),
    "stiffness_falls_with_repeats": (("hinge_stiffness",), "hinges"),
    "sensor_play": (("sensor_scale",), "sensor"),
    "sensor_creep": (("sensor_scale",), "sensor"),
    "mains_hum": ((), "sensor"),
    "sensor_dead_band": (("sensor_scale",), "sensor"),
    "coarse_digits": (("sensor_scale",), "sensor"),
    "hinge_detents": (("hinge_stiffness",), "hinges"),
    "tendon": (("hinge_stiffness",), "hinges"),
    "slick_patch": (("floor_friction",), "ground"),
    "soft_patch": (("floor_yields",), "ground"),
    "shaking_floor": (("floor_geometry",), "ground"),
    "hose_at_the_shaft": ((), "shaft"),
    "cable_spring": (("joint_position_torque", "joint_stiffness"), "joints"),
    "torque_cogging": ((), "joints"),
    "torque_saturation": (("torque_scale",), "joints"),
    "joint_friction_by_direction": (("joint_dissipation", "joint_dry_loss"), "joints"),
}


@dataclass(frozen=True)
class ClaimCalibration:
    """Calibration of all listed claims; NaN where there is none.

    A true effect that was not listed has no stated probability; the counts of effects include it,
    these scores do not. `bins` (10, 3): number of claims, their mean probability, share of them
    right.
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
    """Brier and logarithmic score, expected calibration error, and the share of right claims
    among those at 90 % or more.
    """
    p, hit = _claims(judged)
    if not len(p):
        return ClaimCalibration(np.nan, np.nan, np.nan, 0, np.nan, ())
    bounded = np.clip(p, PROBABILITY_FLOOR, 1.0 - PROBABILITY_FLOOR)
    sure = p >= CONFIDENT
    bin_numbers = np.minimum((p * BINS).astype(int), BINS - 1)
    inside = [bin_numbers == b for b in range(BINS)]
    bins = tuple(_describe_bin(p[i], hit[i]) for i in inside)
    confident_right = np.nan
    if sure.any():
        confident_right = float(hit[sure].mean())
    return ClaimCalibration(
        brier=float(((p - hit) ** 2).mean()),
        log_score=float(-np.where(hit, np.log(bounded), np.log(1.0 - bounded)).mean()),
        ece=float(sum(n * abs(mean - right) for n, mean, right in bins if n) / len(p)),
        confident=int(sure.sum()),
        confident_right=confident_right,
        bins=bins,
    )


def _describe_bin(p: Array, hit: Array) -> tuple[int, float, float]:
    """Number of claims in a bin, their mean probability, and the share that is right."""
    if not len(p):
        return 0, np.nan, np.nan
    return len(p), float(p.mean()), float(hit.mean())


def _claims(judged: Judged) -> tuple[Array, Array]:
    pairs: list[tuple[float, bool]] = []
    for truth, answer in judged:
        true = set(truth.effects) | truth.accepted
        pairs += [(claim.probability, bool(claim.members & true)) for claim in answer.claims]
    p = [probability for probability, _ in pairs]
    hit = [is_right for _, is_right in pairs]
    return np.array(p, dtype=float), np.array(hit, dtype=bool)


def calibration_error(
    probability: Array, true: Array, least: float = 0.0, bins: int = BINS
) -> float:
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
    bin_numbers = np.minimum(((probability - least) / (1.0 - least) * bins).astype(int), bins - 1)
    return float(
        sum(
            abs(probability[bin_numbers == b].sum() - true[bin_numbers == b].sum())
            for b in range(bins)
        )
        / len(true)
    )


def values(judged: Judged) -> ParameterAccuracy:
    """Errors of the parameters of effects that are named by their own id, in cases whose true
    law is the catalogue's.
    """
    deviations = [
        deviation
        for truth, answer in judged
        if not truth.lawless
        for claim in answer.named
        for deviation in parameter_errors(truth, claim)
    ]
    if not deviations:
        return ParameterAccuracy(0, np.nan, np.nan)
    errors, covered = zip(*deviations, strict=True)
    inside = [is_covered for is_covered in covered if is_covered is not None]
    inside_share = np.nan
    if inside:
        inside_share = float(np.mean(inside))
    return ParameterAccuracy(len(errors), float(np.median(errors)), inside_share)


def parameter_errors(truth: Truth, claim: Claim) -> list[tuple[float, bool | None]]:
    """(relative error, whether the truth is inside the 90 % interval) of each parameter of a claim;
    empty for a false claim.

    Errors are relative to what the effect changes: a gain of 1.03 found as 1.02 is off by a third.
    A whole number is right or wrong.
    """
    true = truth.effects.get(claim.id, {})
    return [
        _error(claim.id, name, true[name], value)
        for name, value in claim.parameters.items()
        if name in true
    ]


def _error(
    effect: str, name: str, true: float, estimate: tuple[float, float]
) -> tuple[float, bool | None]:
    value, std = estimate
    if name in WHOLE_NUMBERS:
        return float(round(value) != round(true)), None
    span = SIZE_RANGES.get(effect, {}).get(name)
    around = 0.0
    if span:
        around = span.around
    size = abs(true - around)
    return abs(value - true) / size, abs(value - true) <= NINETY_PERCENT * std


@dataclass(frozen=True)
class StatementScores:
    """Counts as (hits, of).

    - `singles`: detectable single effects of which the effect, or its family, is stated and nothing
      wrong.
    - `claims_on_nothing`: cases with nothing missing in which an effect or family is stated.
    - `wrong`: wrong ones of all statements at SURE_PROBABILITY or more.
    - `family`: approximate laws whose family, or effect, is stated and nothing wrong.
    - `sizes`: parameters of true effects inside their 90 % intervals; `family_sizes`: the same
      where the law is approximate.
    - `triples`: cases of three effects in which two or more are stated and nothing wrong.
    - `place`: effects outside the catalogue that are unexplained and located rightly, of those with
      a place.
    - `calibration_error`: expected calibration error of the `probabilities` of MIN_PROBABILITY or
      more, NaN where there are none.
    """

    singles: tuple[int, int]
    claims_on_nothing: tuple[int, int]
    wrong: tuple[int, int]
    family: tuple[int, int]
    sizes: tuple[int, int]
    family_sizes: tuple[int, int]
    triples: tuple[int, int]
    place: tuple[int, int]
    calibration_error: float
    probabilities: int


def score_statements(judged: Judged) -> StatementScores:
    """Score the statements of these cases."""
    null = [answer for truth, answer in judged if truth.kind in NULL_KINDS]
    sure = [
        right
        for truth, answer in judged
        for probability, right in statements(truth, answer)
        if probability >= SURE_PROBABILITY
    ]
    approximate = [pair for pair in judged if pair[0].kind == cases.APPROXIMATE]
    triples = [pair for pair in judged if pair[0].kind == cases.TRIPLE]
    singles = [
        pair for pair in judged if pair[0].kind in SINGLE_KINDS and pair[0].left >= DETECTABLE
    ]
    lawful = [pair for pair in judged if not pair[0].lawless]
    placed = [
        answer.place == STRANGERS[name][1]
        for truth, answer in judged
        for name in truth.strangers
        if answer.grade == "unexplained" and answer.place and name in STRANGERS
    ]
    probability, true = _probabilities(judged)
    error = float("nan")
    if true:
        error = calibration_error(
            np.array(probability), np.array(true), MIN_PROBABILITY, STATEMENT_BINS
        )
    return StatementScores(
        singles=(sum(has_right_family(*pair) for pair in singles), len(singles)),
        claims_on_nothing=(
            sum(bool(answer.stated or _family_alone(answer)) for answer in null),
            len(null),
        ),
        wrong=(sum(not right for right in sure), len(sure)),
        family=(sum(has_right_family(*pair) for pair in approximate), len(approximate)),
        sizes=_count_covered(lawful),
        family_sizes=_count_covered(approximate),
        triples=(sum(_states_two(*pair) for pair in triples), len(triples)),
        place=(sum(placed), len(placed)),
        calibration_error=error,
        probabilities=len(probability),
    )


def statements(truth: Truth, answer: ParsedDiagnosis) -> Iterator[tuple[float, bool]]:
    """Stated probability of each statement of a case, and whether the statement is true."""
    for claim in answer.stated:
        yield claim.probability, is_true("effect", claim.members, truth)
    if not answer.stated and _family_alone(answer):
        yield answer.probability, is_true("family", {answer.family}, truth)


def _family_alone(answer: ParsedDiagnosis) -> bool:
    return answer.grade == "family" and bool(answer.family)


def is_true(kind: str, names: Collection[str], truth: Truth) -> bool:
    """Whether the case hides one of these effects, or a member of one of these families.

    `kind` is "effect" or "family". An effect outside the catalogue counts for its family.
    """
    true_effects = truth.effects.keys() | truth.accepted
    if kind == "effect":
        return bool(true_effects & set(names))
    of_strangers: set[str] = set()
    for stranger in truth.strangers:
        families, _ = STRANGERS.get(stranger, ((), ""))
        of_strangers.update(families)
    return any(members_of(name) & true_effects or name in of_strangers for name in names)


def has_right_family(truth: Truth, answer: ParsedDiagnosis) -> bool:
    """Whether an effect or a family is stated, and all statements belong to families of true
    effects.
    """
    right = _list_families(truth.effects)
    stated = [_list_families(claim.members) for claim in answer.stated]
    if not stated and _family_alone(answer):
        stated = [{answer.family}]
    return bool(stated) and all(families & right for families in stated)


def _list_families(effects: Iterable[str]) -> set[str]:
    """Ids of all families that one of these effects belongs to."""
    return {family.id for effect in effects for family in families_of(effect)}


def names_confidently(answer: ParsedDiagnosis) -> bool:
    """Whether an effect is named at CONFIDENT or more."""
    return any(claim.probability >= CONFIDENT for claim in answer.named)


def _states_two(truth: Truth, answer: ParsedDiagnosis) -> bool:
    hits = [bool(claim.members & truth.effects.keys()) for claim in answer.stated]
    return len(hits) >= 2 and all(hits)


def _count_covered(judged: Judged) -> tuple[int, int]:
    inside = [
        covered
        for truth, answer in judged
        for claim in answer.stated
        for _, covered in parameter_errors(truth, claim)
        if covered is not None
    ]
    return sum(inside), len(inside)


def _probabilities(judged: Judged) -> tuple[list[float], list[bool]]:
    """Probabilities, and whether each is right, of every effect and family of the best
    explanation, stated or not.
    """
    pairs = []
    for truth, answer in judged:
        for kind, names, probability in answer.support:
            if probability >= MIN_PROBABILITY:
                pairs.append((probability, is_true(kind, names, truth)))
    return [probability for probability, _ in pairs], [right for _, right in pairs]
