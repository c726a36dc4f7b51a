"""One run as the logbook lists it, and queries of such entries."""

import math
import re
from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass, replace
from datetime import datetime, timedelta
from typing import Any

from rfca_rig.errors import BadInput, Trip
from rfca_rig.escaping import printable
from rfca_rig.recording.layout import LISTENING
from rfca_rig.suggestions import suggestion

KINDS = ("dynamic", "static", "fatigue", LISTENING, "imported")
ENDINGS = (
    "done",
    "stopped",
    "tripped",
    "worn out",
    "failed",
    "interrupted",
    "unfinished",
    "damaged",
)
SOURCES = ("SIM", "REAL", "IMPORT")

VERDICTS = (
    "named",
    "mostly",
    "family",
    "nothing missing",
    "unexplained",
    "not enough data",
    "none",
)


@dataclass(frozen=True)
class LoggedCondition:
    """A condition that was recorded: height of the shaft and, of strokes and cycles, its speed."""

    height_mm: float
    speed_rad_s: float | None = None


@dataclass(frozen=True)
class Verdict:
    """Result of a diagnosis: the verdict, the identified effects, the probability of the most
    certain one, and its file.
    """

    words: str
    effects: tuple[str, ...] = ()
    probability: float | None = None
    file: str = ""


@dataclass(frozen=True)
class Entry:
    """One run. `folder` is the path from the folder of all runs. `began_s` is in seconds since
    1970.

    `ended` is one of ENDINGS, or "" where it is unknown, as of an imported recording; `code` is
    that of a trip. `why` is the reason of the end, or the damage. "interrupted" means cut off and
    recovered, "unfinished" going on or cut off. `swings` counts the recordings of a pendulum,
    `motions` those of a mechanism; `named_conditions` are its conditions, and `seconds` their
    duration in all.
    """

    folder: str
    title: str
    source: str
    kind: str
    began_s: float
    operator: str = ""
    sample: str = ""
    conditions: tuple[LoggedCondition, ...] = ()
    strokes: int = 0
    static_stages: int = 0
    cycles: int = 0
    ended: str = ""
    code: str = ""
    why: str = ""
    identity: str = ""
    verdict: Verdict | None = None
    swings: int = 0
    motions: int = 0
    named_conditions: tuple[str, ...] = ()
    seconds: float | None = None

    def __post_init__(self) -> None:
        for name in ("title", "operator", "sample", "why"):
            object.__setattr__(self, name, printable(getattr(self, name)))

    def plain(self) -> dict[str, Any]:
        """As types that JSON has."""
        return asdict(self)

    def with_verdict(self, verdict: Verdict | None) -> "Entry":
        return replace(self, verdict=verdict)


def entry_of(content: Mapping[str, Any]) -> Entry:
    """The entry from the data of `plain`, without a verdict. Raises TypeError or LookupError for
    anything else.
    """
    conditions = tuple(LoggedCondition(**condition) for condition in content["conditions"])
    named = tuple(content["named_conditions"])
    return Entry(
        **{**content, "conditions": conditions, "named_conditions": named, "verdict": None}
    )


@dataclass(frozen=True)
class Span:
    """The closed interval from `low` to `high`."""

    low: float = -math.inf
    high: float = math.inf

    def holds(self, value: float) -> bool:
        return self.low <= value <= self.high


@dataclass(frozen=True)
class RunQuery:
    """Criteria; None and "" match everything. All `words` must occur in title or folder. Height
    and speed must hold for one condition.
    """

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
        # Both for the same condition: 215 mm at one speed and 230 mm at another do not make 215 mm
        # at the other.
        return any(
            _at(self.height_mm, condition.height_mm)
            and _at(self.speed_rad_s, condition.speed_rad_s)
            for condition in conditions
        )


def _within(part: str, whole: str) -> bool:
    return part.casefold() in whole.casefold()


def _at(span: Span | None, value: float | None) -> bool:
    return span is None or (value is not None and span.holds(value))


def span_of(text: str, option: str) -> Span:
    """`215` matches what rounds to it, `2.4..2.5` is a range, `..220` and `230..` are half-open.
    Raises BadInput for anything else.
    """
    low, dots, high = text.partition("..")
    if not dots:
        value = _number(text, option, text)
        # Half a unit of the last digit that was typed.
        half = 0.5 * 10.0 ** -len(text.strip().partition(".")[2])
        return Span(value - half, value + half)
    lowest = -math.inf
    if low:
        lowest = _number(low, option, text)
    highest = math.inf
    if high:
        highest = _number(high, option, text)
    span = Span(lowest, highest)
    if not (low or high) or span.low > span.high:
        raise BadInput(f"{option} {text}: is no range; write the lower end first, as in 2.4..2.5")
    return span


def _number(text: str, option: str, whole: str) -> float:
    # Stricter than float(), which would also take nan, inf and 1e3.
    if not re.fullmatch(r"\s*-?\d+(\.\d*)?\s*", text):
        raise BadInput(
            f"{option} {whole}: should be a number or a range, such as 215 or 2.4..2.5, "
            "..220, 230.."
        )
    return float(text)


def since_until(since: str, until: str) -> Span:
    """From days as 2026-11-01, or moments as 2026-11-01T14:30, in local time. The day of `until`
    is included.
    """
    if since:
        low = _moment(since, "--since").timestamp()
    else:
        low = -math.inf
    if not until:
        return Span(low)
    end = _moment(until, "--until")
    is_day = len(until) <= len("2026-11-01")
    if not is_day:
        return Span(low, end.timestamp())
    # A day ends just before the next one begins, at the last floating-point number before it.
    return Span(low, math.nextafter((end + timedelta(days=1)).timestamp(), 0.0))


def _moment(text: str, option: str) -> datetime:
    try:
        return datetime.fromisoformat(text).astimezone()
    except (ValueError, OverflowError, OSError):
        raise BadInput(
            f"{option} {text}: is no date; write it as 2026-11-01 or 2026-11-01T14:30"
        ) from None


def one_of(text: str, known: Iterable[str], option: str) -> str:
    """The one of `known` that was meant, ignoring case. Raises BadInput with the known ones and
    a suggestion.
    """
    listed = list(known)
    for name in listed:
        if text.casefold() in (name.casefold(), name.casefold().replace(" ", "-")):
            return name
    raise BadInput(f"{option} {text}: is unknown; {suggestion(text, listed)}")


def kind_of(text: str) -> str:
    if text:
        return one_of(text, KINDS, "--kind")
    return ""


def source_of(text: str) -> str:
    if text:
        return one_of(text, SOURCES, "--source")
    return ""


def ending_of(text: str) -> str:
    """How a run ended, or a trip code."""
    # Codes first: no ending looks like one.
    if text.upper() in {code.value for code in Trip}:
        return text.upper()
    if text:
        return one_of(text, ENDINGS, "--ended")
    return ""


def verdict_of(text: str, effects: Iterable[str]) -> str:
    """A verdict, or the id of an effect."""
    if text:
        return one_of(text, (*VERDICTS, *effects), "--verdict")
    return ""
