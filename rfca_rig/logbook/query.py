"""Queries of the logbook."""

import math
import re
from collections.abc import Iterable
from dataclasses import dataclass
from datetime import datetime, timedelta

from rfca_rig.errors import BadInput
from rfca_rig.logbook.entry import ENDINGS, KINDS, SOURCES, Entry, LoggedCondition
from rfca_rig.suggestions import suggestion
from rfca_rig.trip_codes import Trip

VERDICTS = ("named", "mostly", "family", "nothing missing", "unexplained", "not enough data", "none")


@dataclass(frozen=True)
class Span:
    """The closed interval from `low` to `high`."""

    low: float = -math.inf
    high: float = math.inf

    def holds(self, value: float) -> bool:
        return self.low <= value <= self.high


@dataclass(frozen=True)
class RunQuery:
    """Criteria; None and "" match everything. All `words` must occur in title or folder. Height and speed must hold for one condition."""

    height_mm: Span | None = None
    speed_rad_s: Span | None = None
    began_s: Span = Span()
    kind: str = ""
    source: str = ""
    ended: str = ""
    verdict: str = ""
    sample: str = ""
    operator: str = ""
    words: tuple[str, ...] = ()

    def fits(self, entry: Entry) -> bool:
        return (
            self.kind in ("", entry.kind)
            and self.source in ("", entry.source)
            and self.ended in ("", entry.ended, entry.code)
            and self.began_s.holds(entry.began_s)
            and _within(self.sample, entry.sample)
            and _within(self.operator, entry.operator)
            and all(_within(word, f"{entry.title} {entry.folder}") for word in self.words)
            and self._has_verdict(entry)
            and self._has_condition(entry.conditions)
        )

    def _has_verdict(self, entry: Entry) -> bool:
        if not self.verdict:
            return True
        # A run without a diagnosis only matches the query for that.
        if entry.verdict is None:
            return self.verdict == "none"
        return self.verdict in (entry.verdict.words, *entry.verdict.effects)

    def _has_condition(self, conditions: Iterable[LoggedCondition]) -> bool:
        if self.height_mm is None and self.speed_rad_s is None:
            return True
        # Both for the same condition: 215 mm at one speed and 230 mm at another do not make 215 mm at the other.
        return any(_at(self.height_mm, one.height_mm) and _at(self.speed_rad_s, one.speed_rad_s) for one in conditions)


def _within(part: str, whole: str) -> bool:
    return part.casefold() in whole.casefold()


def _at(span: Span | None, value: float | None) -> bool:
    return span is None or (value is not None and span.holds(value))


def span_of(text: str, option: str) -> Span:
    """`215` matches what rounds to it, `2.4..2.5` is a range, `..220` and `230..` are half-open. Raises BadInput for anything else."""
    low, dots, high = text.partition("..")
    if not dots:
        value = _number(text, option, text)
        # Half a unit of the last digit that was typed.
        half = 0.5 * 10.0 ** -len(text.strip().partition(".")[2])
        return Span(value - half, value + half)
    span = Span(_number(low, option, text) if low else -math.inf, _number(high, option, text) if high else math.inf)
    if not (low or high) or span.low > span.high:
        raise BadInput(f"{option} {text}: is no range; write the lower end first, as in 2.4..2.5")
    return span


def _number(text: str, option: str, whole: str) -> float:
    # Stricter than float(), which would also take nan, inf and 1e3.
    if not re.fullmatch(r"\s*-?\d+(\.\d*)?\s*", text):
        raise BadInput(f"{option} {whole}: should be a number or a range, such as 215 or 2.4..2.5, ..220, 230..")
    return float(text)


def since_until(since: str, until: str) -> Span:
    """From days as 2026-11-01, or moments as 2026-11-01T14:30, in local time. The day of `until` is included."""
    low = _moment(since, "--since").timestamp() if since else -math.inf
    if not until:
        return Span(low)
    end = _moment(until, "--until")
    # A day ends just before the next one begins, at the last floating-point number before it.
    is_day = len(until) <= len("2026-11-01")
    return Span(low, math.nextafter((end + timedelta(days=1)).timestamp(), 0.0) if is_day else end.timestamp())


def _moment(text: str, option: str) -> datetime:
    try:
        return datetime.fromisoformat(text).astimezone()
    except (ValueError, OverflowError, OSError):
        raise BadInput(f"{option} {text}: is no date; write it as 2026-11-01 or 2026-11-01T14:30") from None


def one_of(text: str, known: Iterable[str], option: str) -> str:
    """The one of `known` that was meant, ignoring case. Raises BadInput with the known ones and a suggestion."""
    listed = list(known)
    for one in listed:
        if text.casefold() in (one.casefold(), one.casefold().replace(" ", "-")):
            return one
    raise BadInput(f"{option} {text}: is unknown; {suggestion(text, listed)}")


def kind_of(text: str) -> str:
    return one_of(text, KINDS, "--kind") if text else ""


def source_of(text: str) -> str:
    return one_of(text, SOURCES, "--source") if text else ""


def ending_of(text: str) -> str:
    """How a run ended, or a trip code."""
    # Codes first: no ending looks like one.
    if text.upper() in {code.value for code in Trip}:
        return text.upper()
    return one_of(text, ENDINGS, "--ended") if text else ""


def verdict_of(text: str, effects: Iterable[str]) -> str:
    """A verdict, or the id of an effect."""
    return one_of(text, (*VERDICTS, *effects), "--verdict") if text else ""
