"""What a diagnosis said about one case: the part of `diagnosis.json` that is scored."""

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
    """One effect that was listed: how probable, its parameters as (value, one standard deviation), what it cannot be told from."""

    id: str
    probability: float
    parameters: Mapping[str, Value] = field(default_factory=dict)
    cannot_tell_from: tuple[str, ...] = ()

    @property
    def members(self) -> frozenset[str]:
        """The class that the claim stands for."""
        return frozenset((self.id, *self.cannot_tell_from))


@dataclass(frozen=True)
class Said:
    """A diagnosis. `verdict` is "refused" where the campaign was turned down as unusable, with an error instead of a diagnosis.

    `claims` are all effects listed; they count as named where the verdict says so. `held_out_fz_N` is (before, after, noise floor).
    Of rfca-diagnosis/2: `grade`, the stated `family` and its or the effects' `probability`, the `place` of something
    unlisted, and the `support`: kind, ids and probability of every effect, with those that it
    cannot be told from, and of every family of the best explanation.
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
        """The claims that the diagnosis stands by."""
        return self.claims if self.verdict == NAMED else ()

    @property
    def stated(self) -> tuple[Claim, ...]:
        """The effects that are stated at any grade."""
        return self.claims if self.grade in ("identified", "mostly") else self.named


def said_in(diagnosis: Mapping[str, Any], where: str = "diagnosis") -> Said:
    """A diagnosis from the data of its file. Raises BadInput, naming `where` and the key, for what the format does not allow."""
    if diagnosis.get("format") not in FORMATS:
        raise BadInput(f"{where}: format {diagnosis.get('format')!r} should be {' or '.join(FORMATS)}")
    if diagnosis.get("verdict") not in VERDICTS[:-1]:
        raise BadInput(f"{where}: verdict {diagnosis.get('verdict')!r} should be one of {', '.join(VERDICTS[:-1])}")
    try:
        claims = tuple(_claim(effect) for effect in diagnosis.get("effects", ()))
        return Said(
            diagnosis["verdict"],
            claims,
            _held_out(diagnosis.get("fit") or {}),
            grade=str(diagnosis.get("grade") or ""),
            family=str((diagnosis.get("family") or {}).get("id", "")),
            probability=float((diagnosis.get("statement") or {}).get("probability") or 0.0),
            place=str((diagnosis.get("place") or {}).get("id", "")),
            support=tuple(_support(one) for one in diagnosis.get("support") or ()),
        )
    except (KeyError, TypeError, ValueError) as error:
        raise BadInput(f"{where}: {type(error).__name__} at {error}; see the format of diagnosis.json") from None


def read_said(path: Path) -> Said:
    """The diagnosis in a file; one that is not there counts as refused."""
    if not path.is_file():
        return Said(REFUSED)
    try:
        return said_in(json.loads(path.read_text(encoding="utf-8")), str(path))
    except json.JSONDecodeError as error:
        raise BadInput(f"{path}:{error.lineno}: is not JSON: {error.msg}") from None


def _claim(effect: Mapping[str, Any]) -> Claim:
    values = {name: (float(each["value"]), float(each["std"])) for name, each in effect.get("parameters", {}).items()}
    return Claim(str(effect["id"]), float(effect["probability"]), values, tuple(effect.get("cannot_tell_from", ())))


def _support(one: Mapping[str, Any]) -> tuple[str, frozenset[str], float]:
    return str(one["kind"]), frozenset((str(one["id"]), *one.get("cannot_tell_from", ()))), float(one["probability"])


def _held_out(fit: Mapping[str, Any]) -> tuple[float, float, float] | None:
    held_out = fit.get("held_out_rms_fz_N")
    if not held_out or any(held_out.get(key) is None for key in ("before", "after", "noise_floor")):
        return None
    return float(held_out["before"]), float(held_out["after"]), float(held_out["noise_floor"])
