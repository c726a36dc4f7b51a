"""The twenty worst answers, with what is wrong about them: what to look at first."""

from dataclasses import dataclass

from rfca_rig.exam.answer import Said
from rfca_rig.exam.claims import Judged, parameter_errors
from rfca_rig.exam.outcome import EXTRA, PARTIAL, SILENT, WRONG, Truth, false_claims, outcome
from rfca_rig.exam.statements import SURE, statements

LISTED = 20
VALUE_OFF = 0.5  # relative error of a parameter from which a right name counts among the worst


@dataclass(frozen=True)
class Miss:
    """One bad answer; `badness` is 3 and more for a false name, above 2 for another false statement, 1 to 2 for a true one missed,
    below 1 for a value that is off.
    """

    case: str
    kind: str
    badness: float
    reason: str


def worst(judged: Judged) -> tuple[Miss, ...]:
    """The worst first."""
    misses = [miss for pair in judged if (miss := _miss(*pair)) is not None]
    return tuple(sorted(misses, key=lambda miss: (-miss.badness, miss.case))[:LISTED])


def _miss(truth: Truth, said: Said) -> Miss | None:
    wrong = [probability for probability, right in statements(truth, said) if probability >= SURE and not right]
    if wrong and not said.named:
        stated = " and ".join(claim.id for claim in said.stated) or said.family
        there = " and ".join((*truth.effects, *truth.strangers)) or "nothing"
        return Miss(truth.case, truth.kind, 2.0 + max(wrong), f"stated {stated} as {said.grade} at {max(wrong):.0%}, there is {there}")
    came = outcome(truth, said)
    there = " and ".join(truth.effects) or ("something that no name fits" if truth.nameless else "nothing")
    if came in (WRONG, EXTRA):
        false = max(false_claims(truth, said) or said.named, key=lambda claim: claim.probability)
        level = 4.0 if came == WRONG else 3.0
        reason = f"named {false.id} at {false.probability:.0%}, {'which is not there' if came == EXTRA else f'there is {there}'}"
        return Miss(truth.case, truth.kind, level + false.probability, reason)
    if came == SILENT:
        return _missed(truth, there, truth.left)
    if came == PARTIAL:
        missed = sorted(set(truth.effects).difference(*(claim.members for claim in said.named)))
        return _missed(truth, " and ".join(missed), max(truth.left_of_each[effect] for effect in missed))
    return _value_off(truth, said)


def _missed(truth: Truth, what: str, left: float) -> Miss:
    """`left` is how far that shifts the forces beyond what nominal values can explain, in units of the noise."""
    seen = min(left / 100.0, 1.0)
    return Miss(truth.case, truth.kind, 1.0 + seen, f"missed {what}, which shifts the forces by {left:.1f} times the noise")


def _value_off(truth: Truth, said: Said) -> Miss | None:
    errors = [(error, claim.id) for claim in said.named for error, _ in parameter_errors(truth, claim)]
    if truth.lawless or not errors or max(errors)[0] < VALUE_OFF:
        return None
    error, effect = max(errors)
    return Miss(truth.case, truth.kind, min(error / 10.0, 0.99), f"a parameter of {effect} is off by {error:.0%}")
