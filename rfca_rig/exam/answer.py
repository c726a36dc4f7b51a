"""The diagnosis of one case: the part of `diagnosis.json` that is scored.

The outcome of a case is truth and diagnosis compared, as one word.
"""

import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from rfca_rig.errors import BadInput

FORMATS = ("rfca-diagnosis/1", "rfca-diagnosis/2")
NOTHING, NAMED, UNEXPLAINED, NOT_ENOUGH, REFUSED = VERDICTS = (
    "nothing missing",
    "named",
    "unexplained",
    "not enough data",
    "refused",
)

Value = tuple[float, float]

# Shift of the signals that nominal values cannot explain, in units of a sample's noise, from which
# an effect can be found.
DETECTABLE = 2.0

RIGHT, CLASS, PARTIAL, EXTRA, WRONG, SILENT, CAUTIOUS = OUTCOMES = (
    "right",
    "class",
    "partial",
    "extra",
    "wrong",
    "silent",
    "cautious",
)


@dataclass(frozen=True)
class Claim:
    """One listed effect: its probability, its parameters as (value, standard deviation), and
    effects indistinguishable from it.
    """

    id: str
    probability: float
    parameters: Mapping[str, Value] = field(default_factory=dict)
    cannot_tell_from: tuple[str, ...] = ()

    @property
    def members(self) -> frozenset[str]:
        """The indistinguishable set of the claim, with the effect itself."""
        return frozenset((self.id, *self.cannot_tell_from))


@dataclass(frozen=True)
class ParsedDiagnosis:
    """A diagnosis. `verdict` is "refused" where the campaign was rejected as unusable, with an
    error instead of a diagnosis.

    `claims` are all effects listed; they count as named where the verdict says so. `held_out_fz_N`
    is (before, after, noise floor). The following are of format rfca-diagnosis/2:

    - `grade`, the stated `family`, and the `probability` of the family or the effects;
    - `place`: where something outside the catalogue acts;
    - `support`: kind, ids and probability of every effect, with its indistinguishable ones, and
      every family of the best explanation.
    """

    verdict: str
    claims: tuple[Claim, ...] = ()
    held_out_fz_N: tuple[float, float, float] | None = None
    grade: str = ""
    family: str = ""
    probability: float = 0.0
    place: str = ""
    support: tuple[tuple[str, frozenset[str], float], ...] = ()

    @property
    def named(self) -> tuple[Claim, ...]:
        """The claims of a diagnosis with the verdict "named"."""
        if self.verdict == NAMED:
            return self.claims
        return ()

    @property
    def named_ids(self) -> set[str]:
        """Ids of the named effects."""
        return {claim.id for claim in self.named}

    @property
    def stated(self) -> tuple[Claim, ...]:
        """The effects that are stated at any grade; files of format 1 have no grade."""
        if self.grade in ("identified", "mostly"):
            return self.claims
        return self.named


def parse_diagnosis(diagnosis: Mapping[str, Any], where: str = "diagnosis") -> ParsedDiagnosis:
    """A diagnosis from the data of its file. Raises BadInput, naming `where` and the key, for
    what the format does not allow.
    """
    # A file never says "refused": that verdict, the last one, is given where there is no file.
    if diagnosis.get("format") not in FORMATS:
        raise BadInput(
            f"{where}: format {diagnosis.get('format')!r} should be {' or '.join(FORMATS)}"
        )
    if diagnosis.get("verdict") not in VERDICTS[:-1]:
        raise BadInput(
            f"{where}: verdict {diagnosis.get('verdict')!r} should be one of "
            f"{', '.join(VERDICTS[:-1])}"
        )
    try:
        claims = tuple(_read_claim(effect) for effect in diagnosis.get("effects", ()))
        return ParsedDiagnosis(
            diagnosis["verdict"],
            claims,
            _read_held_out(diagnosis.get("fit") or {}),
            grade=str(diagnosis.get("grade") or ""),
            family=str((diagnosis.get("family") or {}).get("id", "")),
            probability=float((diagnosis.get("statement") or {}).get("probability") or 0.0),
            place=str((diagnosis.get("place") or {}).get("id", "")),
            support=tuple(
                (
                    str(statement["kind"]),
                    frozenset((str(statement["id"]), *statement.get("cannot_tell_from", ()))),
                    float(statement["probability"]),
                )
                for statement in diagnosis.get("support") or ()
            ),
        )
    except (KeyError, TypeError, ValueError) as error:
        raise BadInput(
            f"{where}: {type(error).__name__} at {error}; see the format of diagnosis.json"
        ) from None


def read_diagnosis(path: Path) -> ParsedDiagnosis:
    """The diagnosis in a file; a missing file counts as refused. Raises BadInput for a file of
    another format.
    """
    if not path.is_file():
        return ParsedDiagnosis(REFUSED)
    try:
        return parse_diagnosis(json.loads(path.read_text(encoding="utf-8")), str(path))
    except json.JSONDecodeError as error:
        raise BadInput(f"{path}:{error.lineno}: is not JSON: {error.msg}") from None


def _read_claim(effect: Mapping[str, Any]) -> Claim:
    values = {
        name: (float(estimate["value"]), float(estimate["std"]))
        for name, estimate in effect.get("parameters", {}).items()
    }
    return Claim(
        str(effect["id"]),
        float(effect["probability"]),
        values,
        tuple(effect.get("cannot_tell_from", ())),
    )


def _read_held_out(fit: Mapping[str, Any]) -> tuple[float, float, float] | None:
    held_out = fit.get("held_out_rms_fz_N")
    if not held_out or any(held_out.get(key) is None for key in ("before", "after", "noise_floor")):
        return None
    return float(held_out["before"]), float(held_out["after"]), float(held_out["noise_floor"])


"""right: names exactly what is there, or nothing where nothing is, or says that it cannot explain
what no name fits.
class: every true effect lies in the class of a claim.
partial: some of the true effects, nothing false.
extra: all of them and something false. wrong: something false, and not all that is true.
silent: nothing stated, or "nothing missing", though something is.
cautious: "unexplained" where a cause could be named, or nothing is missing.
"""


@dataclass(frozen=True)
class Truth:
    """The part of a truth that is scored.

    - `effects` with their parameters, `strangers` (outside the catalogue) by name; `accepted` are
      further right names.
    - `nameless`: something is wrong that no effect describes, so that only "unexplained", or a
      refusal, is right.
    - `lawless`: the true law is not the catalogue's, so parameters are not compared.
    - `poor`: too few conditions for a statement.
    - `left`: shift of the forces beyond what nominal values can explain, in units of the noise;
      `left_of_each` for each effect alone.
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
        left=_size(truth["size"]["left_over_noise"]),
        left_of_each=_sizes(truth["left_of_each"]),
        faintest_above=_least(_sizes(truth.get("above_of_each", {}))),
    )


def _sizes(of_each: Mapping[str, float | None]) -> dict[str, float]:
    return {effect: _size(size) for effect, size in of_each.items()}


def _size(size: float | None) -> float:
    # null in the file stands for infinity.
    if size is None:
        return float("inf")
    return size


def _least(of_each: Mapping[str, float]) -> float:
    return min(of_each.values(), default=float("inf"))


def false_claims(truth: Truth, answer: ParsedDiagnosis) -> tuple[Claim, ...]:
    """Named effects whose indistinguishable set holds no true effect."""
    true = frozenset(truth.effects) | truth.accepted
    return tuple(claim for claim in answer.named if not claim.members & true)


def outcome(truth: Truth, answer: ParsedDiagnosis) -> str:
    """The outcome of a case, one of OUTCOMES."""
    if answer.named:
        return _of_names(truth, answer)
    if truth.nameless:
        if answer.verdict == NOTHING and not truth.silence_is_right:
            return SILENT
        return RIGHT
    if answer.verdict == NOTHING:
        if truth.effects:
            return SILENT
        return RIGHT
    # What remains is no statement: that is right only where the data do not allow one, or where no
    # effect describes the deviation.
    if answer.verdict in (NOT_ENOUGH, REFUSED):
        if truth.poor:
            return RIGHT
        return CAUTIOUS
    if truth.lawless or (truth.model_error and not truth.effects):
        return RIGHT
    return CAUTIOUS


def _of_names(truth: Truth, answer: ParsedDiagnosis) -> str:
    wrong = false_claims(truth, answer)
    ids = answer.named_ids
    covered = frozenset().union(*(claim.members for claim in answer.named))
    if truth.nameless and not truth.effects:
        if wrong or not truth.accepted:
            return WRONG
        return RIGHT
    missed = set(truth.effects) - covered
    if wrong:
        if missed or not truth.effects:
            return WRONG
        return EXTRA
    if missed:
        return PARTIAL
    if ids == set(truth.effects):
        return RIGHT
    return CLASS
