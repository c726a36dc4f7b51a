"""The twenty worst answers, each with the reason: the first ones to look at."""

from dataclasses import dataclass

from rfca_rig.exam.answer import ParsedDiagnosis
from rfca_rig.exam.claims import Judged, parameter_errors
from rfca_rig.exam.outcome import EXTRA, PARTIAL, SILENT, WRONG, Truth, false_claims, outcome
from rfca_rig.exam.statements import SURE_PROBABILITY, statements

LISTED = 20
# Relative error of a parameter from which a right name counts among the worst.
MIN_VALUE_ERROR = 0.5


@dataclass(frozen=True)
class WorstCase:
    """One bad answer.

    `badness` is 3 or more for a false name, 2 to 3 for another false statement, 1 to 2 for a missed effect, below 1 for a wrong value.
    """

    case: str
    kind: str
    badness: float
    reason: str


def worst(judged: Judged) -> tuple[WorstCase, ...]:
    """The LISTED worst answers, the worst first."""
    misses = [miss for pair in judged if (miss := _miss(*pair)) is not None]
    return tuple(sorted(misses, key=lambda miss: (-miss.badness, miss.case))[:LISTED])


def _miss(truth: Truth, answer: ParsedDiagnosis) -> WorstCase | None:
    wrong = [probability for probability, right in statements(truth, answer) if probability >= SURE_PROBABILITY and not right]
    if wrong and not answer.named:
        stated = " and ".join(claim.id for claim in answer.stated) or answer.family
        there = " and ".join((*truth.effects, *truth.strangers)) or "nothing"
        return WorstCase(
            truth.case, truth.kind, 2.0 + max(wrong), f"stated {stated} as {answer.grade} at {max(wrong):.0%}, there is {there}"
        )
    result = outcome(truth, answer)
    there = " and ".join(truth.effects) or ("something that no name fits" if truth.nameless else "nothing")
    if result in (WRONG, EXTRA):
        false = max(false_claims(truth, answer) or answer.named, key=lambda claim: claim.probability)
        level = 4.0 if result == WRONG else 3.0
        reason = f"named {false.id} at {false.probability:.0%}, {'which is not there' if result == EXTRA else f'there is {there}'}"
        return WorstCase(truth.case, truth.kind, level + false.probability, reason)
    if result == SILENT:
        return _missed_effect(truth, there, truth.left)
    if result == PARTIAL:
        missed = sorted(set(truth.effects).difference(*(claim.members for claim in answer.named)))
        return _missed_effect(truth, " and ".join(missed), max(truth.left_of_each[effect] for effect in missed))
    return _value_off(truth, answer)


def _missed_effect(truth: Truth, what: str, left: float) -> WorstCase:
    """A missed effect; `left` is its shift of the forces beyond what nominal values can explain, in units of the noise."""
    # Larger shifts are worse to miss, up to a hundred times the noise; badness stays between 1 and 2.
    severity = min(left / 100.0, 1.0)
    return WorstCase(truth.case, truth.kind, 1.0 + severity, f"missed {what}, which shifts the forces by {left:.1f} times the noise")


def _value_off(truth: Truth, answer: ParsedDiagnosis) -> WorstCase | None:
    errors = [(error, claim.id) for claim in answer.named for error, _ in parameter_errors(truth, claim)]
    if truth.lawless or not errors or max(errors)[0] < MIN_VALUE_ERROR:
        return None
    error, effect = max(errors)
    return WorstCase(truth.case, truth.kind, min(error / 10.0, 0.99), f"a parameter of {effect} is off by {error:.0%}")
