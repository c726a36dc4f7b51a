"""The diagnosis of one case: the part of `diagnosis.json` that is scored."""

import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from rfca_rig.errors import BadInput

FORMATS = ("rfca-diagnosis/1", "rfca-diagnosis/2")
NOTHING, NAMED, UNEXPLAINED, NOT_ENOUGH, REFUSED = VERDICTS = ("nothing missing", "named", "unexplained", "not enough data", "refused")

Value = tuple[float, float]


@dataclass(frozen=True)
class Claim:
    """One listed effect: its probability, its parameters as (value, standard deviation), and effects indistinguishable from it."""

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
    """A diagnosis. `verdict` is "refused" where the campaign was rejected as unusable, with an error instead of a diagnosis.

    `claims` are all effects listed; they count as named where the verdict says so. `held_out_fz_N` is (before, after, noise floor).
    The following are of format rfca-diagnosis/2:

    - `grade`, the stated `family`, and the `probability` of the family or the effects;
    - `place`: where something outside the catalogue acts;
    - `support`: kind, ids and probability of every effect, with its indistinguishable ones, and every family of the best explanation.
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
        return self.claims if self.verdict == NAMED else ()

    @property
    def stated(self) -> tuple[Claim, ...]:
        """The effects that are stated at any grade; files of format 1 have no grade."""
        return self.claims if self.grade in ("identified", "mostly") else self.named


def parse_diagnosis(diagnosis: Mapping[str, Any], where: str = "diagnosis") -> ParsedDiagnosis:
    """A diagnosis from the data of its file. Raises BadInput, naming `where` and the key, for what the format does not allow."""
    # A file never says "refused": that verdict, the last one, is given where there is no file.
    if diagnosis.get("format") not in FORMATS:
        raise BadInput(f"{where}: format {diagnosis.get('format')!r} should be {' or '.join(FORMATS)}")
    if diagnosis.get("verdict") not in VERDICTS[:-1]:
        raise BadInput(f"{where}: verdict {diagnosis.get('verdict')!r} should be one of {', '.join(VERDICTS[:-1])}")
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
            support=tuple(_read_support(one) for one in diagnosis.get("support") or ()),
        )
    except (KeyError, TypeError, ValueError) as error:
        raise BadInput(f"{where}: {type(error).__name__} at {error}; see the format of diagnosis.json") from None


def read_diagnosis(path: Path) -> ParsedDiagnosis:
    """The diagnosis in a file; a missing file counts as refused. Raises BadInput for a file of another format."""
    if not path.is_file():
        return ParsedDiagnosis(REFUSED)
    try:
        return parse_diagnosis(json.loads(path.read_text(encoding="utf-8")), str(path))
    except json.JSONDecodeError as error:
        raise BadInput(f"{path}:{error.lineno}: is not JSON: {error.msg}") from None


def _read_claim(effect: Mapping[str, Any]) -> Claim:
    values = {name: (float(each["value"]), float(each["std"])) for name, each in effect.get("parameters", {}).items()}
    return Claim(str(effect["id"]), float(effect["probability"]), values, tuple(effect.get("cannot_tell_from", ())))


def _read_support(one: Mapping[str, Any]) -> tuple[str, frozenset[str], float]:
    return str(one["kind"]), frozenset((str(one["id"]), *one.get("cannot_tell_from", ()))), float(one["probability"])


def _read_held_out(fit: Mapping[str, Any]) -> tuple[float, float, float] | None:
    held_out = fit.get("held_out_rms_fz_N")
    if not held_out or any(held_out.get(key) is None for key in ("before", "after", "noise_floor")):
        return None
    return float(held_out["before"]), float(held_out["after"]), float(held_out["noise_floor"])
