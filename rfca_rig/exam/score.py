"""Scores of the exam, from opened truths and the diagnosis of each case."""

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from rfca_rig.exam import cases
from rfca_rig.exam.answer import (
    CLASS,
    DETECTABLE,
    EXTRA,
    NAMED,
    NOTHING,
    PARTIAL,
    RIGHT,
    SILENT,
    WRONG,
    ParsedDiagnosis,
    Truth,
    false_claims,
    outcome,
    parse_truth,
)
from rfca_rig.exam.claims import (
    SURE_PROBABILITY,
    ClaimCalibration,
    Judged,
    ParameterAccuracy,
    StatementScores,
    calibration,
    has_right_family,
    names_confidently,
    parameter_errors,
    score_statements,
    statements,
    values,
)
from rfca_rig.exam.pendulums.cases import PENDULUM_KINDS, PENDULUM_NOTHING

MAX_LISTED = 20
# Relative error of a parameter from which a right name counts among the worst.
MIN_VALUE_ERROR = 0.5

# Bin edges of `power`, in multiples of DETECTABLE.
POWER_AT = (0.5, 1.0, 2.0, 4.0, 8.0, 16.0)

_NULL_KINDS = (cases.NOTHING, cases.MODEL_ERROR)


@dataclass(frozen=True)
class WorstCase:
    """One bad answer.

    `badness` is 3 or more for a false name, 2 to 3 for another false statement, 1 to 2 for a missed
    effect, below 1 for a wrong value.
    """

    case: str
    kind: str
    badness: float
    reason: str


def worst(judged: Judged) -> tuple[WorstCase, ...]:
    """The MAX_LISTED worst answers, the worst first."""
    misses = [miss for pair in judged if (miss := _miss(*pair)) is not None]
    return tuple(sorted(misses, key=lambda miss: (-miss.badness, miss.case))[:MAX_LISTED])


def _miss(truth: Truth, answer: ParsedDiagnosis) -> WorstCase | None:
    wrong = [
        probability
        for probability, right in statements(truth, answer)
        if probability >= SURE_PROBABILITY and not right
    ]
    if wrong and not answer.named:
        stated = " and ".join(claim.id for claim in answer.stated) or answer.family
        hidden_effects = " and ".join((*truth.effects, *truth.strangers)) or "nothing"
        return WorstCase(
            truth.case,
            truth.kind,
            2.0 + max(wrong),
            f"stated {stated} as {answer.grade} at {max(wrong):.0%}, there is {hidden_effects}",
        )
    result = outcome(truth, answer)
    hidden_effects = " and ".join(truth.effects) or (
        "an effect outside the catalogue" if truth.nameless else "nothing"
    )
    if result in (WRONG, EXTRA):
        false = max(
            false_claims(truth, answer) or answer.named, key=lambda claim: claim.probability
        )
        claim = f"identified {false.id} at {false.probability:.0%}"
        if result == WRONG:
            level = 4.0
            reason = f"{claim}, there is {hidden_effects}"
        else:
            level = 3.0
            reason = f"{claim}, which is not there"
        return WorstCase(truth.case, truth.kind, level + false.probability, reason)
    if result == SILENT:
        return _rate_missed_effect(truth, hidden_effects, truth.left)
    if result == PARTIAL:
        missed = sorted(set(truth.effects).difference(*(claim.members for claim in answer.named)))
        return _rate_missed_effect(
            truth, " and ".join(missed), max(truth.left_of_each[effect] for effect in missed)
        )
    errors = [
        (error, claim.id) for claim in answer.named for error, _ in parameter_errors(truth, claim)
    ]
    if truth.lawless or not errors or max(errors)[0] < MIN_VALUE_ERROR:
        return None
    error, effect = max(errors)
    return WorstCase(
        truth.case,
        truth.kind,
        min(error / 10.0, 0.99),
        f"a parameter of {effect} is off by {error:.0%}",
    )


def _rate_missed_effect(truth: Truth, what: str, left: float) -> WorstCase:
    """A missed effect; `left` is its shift of the forces beyond what nominal values can explain,
    in units of the noise.
    """
    # Larger shifts are worse to miss, up to a hundred times the noise; badness stays between 1 and
    # 2.
    severity = min(left / 100.0, 1.0)
    return WorstCase(
        truth.case,
        truth.kind,
        1.0 + severity,
        f"missed {what}, which shifts the forces by {left:.1f} times the noise",
    )


@dataclass(frozen=True)
class Share:
    """`hits` of `of` cases; the bounds are one-sided, at 95 % confidence (Clopper and Pearson)."""

    hits: int
    of: int

    @property
    def value(self) -> float:
        if self.of:
            return self.hits / self.of
        return np.nan

    @property
    def lower(self) -> float:
        """Lower bound of the true share, at 95 % confidence."""
        from scipy.stats import beta  # noqa: PLC0415  (slow to import, and used in reports only)

        if self.hits:
            return float(beta.ppf(0.05, self.hits, self.of - self.hits + 1))
        return 0.0

    @property
    def upper(self) -> float:
        """Upper bound of the true share, at 95 % confidence."""
        from scipy.stats import beta  # noqa: PLC0415

        if self.hits < self.of:
            return float(beta.ppf(0.95, self.hits + 1, self.of - self.hits))
        return 1.0


@dataclass(frozen=True)
class ExamScores:
    """All scores. They are of the leg cases, except names, alarms and `pendulums`, the scores of
    statements about pendulums.

    "Detectable" means shifted by more than DETECTABLE beyond what nominal values explain; "above"
    means as much in units of noise and usual model error.

    - `outcomes`: counts of outcomes per kind.
    - `confusion`: counts of (true effect, named effects or verdict) over cases with one effect.
    - `power`: single effects that are stated, or their family, with nothing wrong, by size: below,
      between and above POWER_AT.
    - `false_alarms`, `missed`, `detection_errors`, `classification_errors`: as in the DXC
      competitions. Missed are of the detectable cases, detection errors of all cases;
      classification errors are the sum of wrong and missing names.
    - `gap_closed`: median over right answers of (before - after) / (before - floor) of fz on
      held-out conditions; `gap_worse` counts those that became worse.
    """

    outcomes: Mapping[str, Mapping[str, int]]
    confusion: Mapping[tuple[str, str], int]
    null_false_claims: Share
    false_discoveries: Share
    single_right: Share
    single_right_detectable: Share
    single_in_class_detectable: Share
    single_in_class_above: Share
    power: tuple[Share, ...]
    pairs_exact: Share
    pairs_exact_detectable: Share
    pairs_exact_above: Share
    pairs_without_wrong: Share
    stranger_unexplained: Share
    stranger_wrong: Share
    stranger_confident_wrong: Share
    stranger_silent_detectable: Share
    wrong_law_acceptable: Share
    mislabelled_wrong: Share
    poor_data_wrong: Share
    truth_in_class: Share
    mean_class_size: float
    false_alarms: Share
    missed: Share
    detection_errors: Share
    classification_errors: int
    calibration: ClaimCalibration
    values: ParameterAccuracy
    gap_closed: float
    gap_worse: Share
    statements: StatementScores
    pendulums: StatementScores
    worst: tuple[WorstCase, ...]


def score(
    truths: Sequence[Mapping[str, Any]], diagnoses: Mapping[str, ParsedDiagnosis]
) -> ExamScores:
    """Score `diagnoses`, by case. A case without one counts as refused."""
    everything = [
        (truth, diagnoses.get(truth.case, ParsedDiagnosis("refused")))
        for truth in map(parse_truth, truths)
    ]
    by_kind = {}
    outcomes = {}
    for kind in cases.KINDS:
        group = [(truth, answer) for truth, answer in everything if truth.kind == kind]
        by_kind[kind] = group
        if group:
            outcomes[kind] = dict(Counter(outcome(*pair) for pair in group))
    judged = [pair for kind in cases.LEG_KINDS for pair in by_kind[kind]]
    single = by_kind[cases.SINGLE]
    pairs = by_kind[cases.PAIR]
    strangers = by_kind[cases.STRANGER]
    detectable = [(truth, answer) for truth, answer in single if truth.left >= DETECTABLE]
    null = [pair for kind in _NULL_KINDS for pair in by_kind[kind]]
    all_null = [*null, *by_kind[PENDULUM_NOTHING]]
    # Parameters and held-out errors are scored where the effects are right: elsewhere they describe
    # something else.
    right = [
        (truth, answer) for truth, answer in (*single, *pairs) if outcome(truth, answer) == RIGHT
    ]
    named = [(truth, answer) for truth, answer in judged if answer.named]
    return ExamScores(
        outcomes=outcomes,
        confusion=confusion(single),
        null_false_claims=Share(sum(bool(answer.named) for _, answer in null), len(null)),
        false_discoveries=Share(
            sum(len(false_claims(*pair)) for pair in everything if pair[1].named),
            sum(len(answer.named) for _, answer in everything),
        ),
        single_right=_share(single, RIGHT),
        single_right_detectable=_share(detectable, RIGHT),
        single_in_class_detectable=_share(detectable, RIGHT, CLASS),
        single_in_class_above=_share(
            [pair for pair in single if pair[0].faintest_above >= DETECTABLE], RIGHT, CLASS
        ),
        power=power(single),
        pairs_exact=_share(pairs, RIGHT),
        pairs_exact_detectable=_share(
            [pair for pair in pairs if pair[0].faintest >= DETECTABLE], RIGHT
        ),
        pairs_exact_above=_share(
            [pair for pair in pairs if pair[0].faintest_above >= DETECTABLE], RIGHT
        ),
        pairs_without_wrong=Share(sum(not false_claims(*pair) for pair in pairs), len(pairs)),
        stranger_unexplained=_share(strangers, RIGHT),
        stranger_wrong=_share(strangers, WRONG),
        stranger_confident_wrong=Share(
            sum(names_confidently(answer) for _, answer in strangers), len(strangers)
        ),
        stranger_silent_detectable=_share(
            [pair for pair in strangers if pair[0].left >= DETECTABLE], SILENT
        ),
        wrong_law_acceptable=_share(by_kind[cases.WRONG_LAW], RIGHT, CLASS),
        mislabelled_wrong=_share(by_kind[cases.MISLABEL], WRONG),
        poor_data_wrong=_share(by_kind[cases.POOR_DATA], WRONG, EXTRA),
        truth_in_class=_truth_in_class(named),
        mean_class_size=_class_size(named),
        false_alarms=Share(sum(_is_alarm(answer) for _, answer in all_null), len(all_null)),
        missed=_share_of_missed(everything),
        detection_errors=Share(
            sum(_is_alarm(answer) != _is_faulty(truth) for truth, answer in everything),
            len(everything),
        ),
        classification_errors=sum(
            len(answer.named_ids ^ set(truth.effects)) for truth, answer in everything
        ),
        calibration=calibration(judged),
        values=values([*single, *pairs]),
        gap_closed=_gap(right),
        gap_worse=Share(sum(gap < 0.0 for gap in _gaps(right)), len(_gaps(right))),
        statements=score_statements(judged),
        pendulums=score_statements([pair for kind in PENDULUM_KINDS for pair in by_kind[kind]]),
        worst=worst(everything),
    )


def confusion(single: Judged) -> dict[tuple[str, str], int]:
    """Counts of (true effect, named effects) over cases with one effect. Several names are
    joined; without a name the verdict counts.
    """
    counts: Counter[tuple[str, str]] = Counter()
    for truth, answer in single:
        true_effect = "+".join(sorted(truth.effects))
        named = "+".join(sorted(claim.id for claim in answer.named))
        counts[true_effect, named or answer.verdict] += 1
    return dict(counts)


def power(single: Judged) -> tuple[Share, ...]:
    """Share of single effects that are stated rightly, or their family, at any grade, for each bin
    of POWER_AT.

    Sizes are in multiples of DETECTABLE, in units of noise and usual model error.
    """
    level = np.searchsorted(
        POWER_AT, [truth.faintest_above / DETECTABLE for truth, _ in single], side="right"
    )
    shares = []
    for k in range(len(POWER_AT) + 1):
        group = [pair for pair, of_pair in zip(single, level, strict=True) if of_pair == k]
        shares.append(Share(sum(has_right_family(*pair) for pair in group), len(group)))
    return tuple(shares)


def _share(judged: Judged, *outcomes: str) -> Share:
    return Share(sum(outcome(*pair) in outcomes for pair in judged), len(judged))


def _is_faulty(truth: Truth) -> bool:
    return bool(truth.effects) or truth.nameless


def _is_alarm(answer: ParsedDiagnosis) -> bool:
    """Whether the answer says that something is missing; doubt about the data is no alarm."""
    return answer.verdict in (NAMED, "unexplained")


def _share_of_missed(judged: Judged) -> Share:
    faulty = [
        answer
        for truth, answer in judged
        if _is_faulty(truth) and truth.left >= DETECTABLE and not truth.silence_is_right
    ]
    return Share(sum(answer.verdict == NOTHING for answer in faulty), len(faulty))


def _truth_in_class(named: Judged) -> Share:
    """Share of cases with true effects and names in which all true effects lie in the
    indistinguishable sets given.
    """
    whole = [outcome(*pair) for pair in named if pair[0].effects]
    # An answer that names only some of the effects says nothing about its sets, so it does not
    # count.
    return Share(
        sum(judgement in (RIGHT, CLASS, EXTRA) for judgement in whole),
        len([judgement for judgement in whole if judgement != PARTIAL]),
    )


def _class_size(named: Judged) -> float:
    sizes = [len(claim.members) for _, answer in named for claim in answer.named]
    if sizes:
        return float(np.mean(sizes))
    return np.nan


def gap_closed(answer: ParsedDiagnosis) -> float | None:
    """Share of the closable gap in fz, between model and held-out recordings, that a diagnosis
    closes; None where it is not stated.

    The gap that can be closed is the one above the noise floor.
    """
    if answer.held_out_fz_N is None:
        return None
    before, after, floor = answer.held_out_fz_N
    if before > floor:
        return (before - after) / (before - floor)
    return None


def _gaps(right: Judged) -> list[float]:
    return [gap for _, answer in right if (gap := gap_closed(answer)) is not None]


def _gap(right: Judged) -> float:
    gaps = _gaps(right)
    if gaps:
        return float(np.median(gaps))
    return np.nan
