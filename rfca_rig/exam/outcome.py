"""The outcome of one case: truth and diagnosis compared, as one word."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from rfca_rig.exam.answer import NOT_ENOUGH, NOTHING, REFUSED, Claim, ParsedDiagnosis

# Shift of the signals that nominal values cannot explain, in units of a sample's noise, from which an effect can be found.
DETECTABLE = 2.0

RIGHT, CLASS, PARTIAL, EXTRA, WRONG, SILENT, CAUTIOUS = OUTCOMES = ("right", "class", "partial", "extra", "wrong", "silent", "cautious")
"""right: names exactly what is there, or nothing where nothing is, or says that it cannot explain what no name fits.
class: every true effect lies in the class of a claim. partial: some of the true effects, nothing false.
extra: all of them and something false. wrong: something false, and not all that is true.
silent: nothing said, or "nothing missing", though something is. cautious: "unexplained" where a name was to be had, or nothing is missing.
"""


@dataclass(frozen=True)
class Truth:
    """The part of a truth that is scored.

    - `effects` with their parameters, `strangers` (outside the catalogue) by name; `accepted` are further right names.
    - `nameless`: something is wrong that no effect describes, so that only "unexplained", or a refusal, is right.
    - `lawless`: the true law is not the catalogue's, so parameters are not compared.
    - `poor`: too few conditions for a statement.
    - `left`: shift of the forces beyond what nominal values can explain, in units of the noise; `left_of_each` for each effect alone.
    - `faintest_above`: the smallest of these shifts, in units of noise and usual model error.
    """

    case: str
    kind: str
    effects: Mapping[str, Mapping[str, float]]
    strangers: tuple[str, ...]
    accepted: frozenset[str]
    nameless: bool
    silence_is_right: bool
    poor: bool
    model_error: bool
    lawless: bool
    strength: float
    left: float
    left_of_each: Mapping[str, float]
    faintest_above: float

    @property
    def faintest(self) -> float:
        return _least(self.left_of_each)


def parse_truth(truth: Mapping[str, Any]) -> Truth:
    """A truth from its sealed data."""
    # null in the file stands for infinity.
    left = truth["size"]["left_over_noise"]
    return Truth(
        case=truth["case"],
        kind=truth["kind"],
        effects=truth["effects"],
        strangers=tuple(truth["strangers"]),
        accepted=frozenset(truth["also_right"]),
        nameless=bool(truth["strangers"]) or truth["mislabelled"] is not None,
        silence_is_right=truth["silence_is_right"],
        poor=len(truth["design"]["conditions"]) < 2,
        model_error=truth["structured"] is not None,
        lawless=truth["uneven"] is not None,
        strength=truth["strength"],
        left=float("inf") if left is None else left,
        left_of_each=_sizes(truth["left_of_each"]),
        faintest_above=_least(_sizes(truth.get("above_of_each", {}))),
    )


def _sizes(of_each: Mapping[str, float | None]) -> dict[str, float]:
    return {effect: float("inf") if size is None else size for effect, size in of_each.items()}


def _least(of_each: Mapping[str, float]) -> float:
    return min(of_each.values(), default=float("inf"))


def false_claims(truth: Truth, said: ParsedDiagnosis) -> tuple[Claim, ...]:
    """Named effects whose indistinguishable set holds no true effect."""
    true = frozenset(truth.effects) | truth.accepted
    return tuple(claim for claim in said.named if not claim.members & true)


def outcome(truth: Truth, said: ParsedDiagnosis) -> str:
    """The outcome of a case, one of OUTCOMES."""
    if said.named:
        return _of_names(truth, said)
    if truth.nameless:
        return SILENT if said.verdict == NOTHING and not truth.silence_is_right else RIGHT
    if said.verdict == NOTHING:
        return SILENT if truth.effects else RIGHT
    # What remains is no statement: that is right only where the data do not allow one, or where no effect describes the deviation.
    if said.verdict in (NOT_ENOUGH, REFUSED):
        return RIGHT if truth.poor else CAUTIOUS
    return RIGHT if truth.lawless or (truth.model_error and not truth.effects) else CAUTIOUS


def _of_names(truth: Truth, answer: ParsedDiagnosis) -> str:
    wrong = false_claims(truth, answer)
    ids = {claim.id for claim in answer.named}
    covered = frozenset().union(*(claim.members for claim in answer.named))
    if truth.nameless and not truth.effects:
        return WRONG if wrong or not truth.accepted else RIGHT
    missed = set(truth.effects) - covered
    if wrong:
        return WRONG if missed or not truth.effects else EXTRA
    if missed:
        return PARTIAL
    return RIGHT if ids == set(truth.effects) else CLASS
