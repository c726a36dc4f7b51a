"""One run as the logbook lists it."""

from collections.abc import Mapping
from dataclasses import asdict, dataclass, replace
from typing import Any

from rfca_rig.suggestions import printable

KINDS = ("dynamic", "static", "fatigue", "imported")
ENDINGS = ("done", "stopped", "tripped", "worn out", "failed", "interrupted", "unfinished", "damaged")
SOURCES = ("SIM", "REAL", "IMPORT")


@dataclass(frozen=True)
class LoggedCondition:
    """A condition that was recorded: height of the shaft and, of strokes and cycles, its speed."""

    height_mm: float
    speed_rad_s: float | None = None


@dataclass(frozen=True)
class Verdict:
    """Result of a diagnosis: the verdict, the identified effects, the probability of the most certain one, and its file."""

    words: str
    effects: tuple[str, ...] = ()
    probability: float | None = None
    file: str = ""


@dataclass(frozen=True)
class Entry:
    """One run. `folder` is the path from the folder of all runs. `began_s` is in seconds since 1970.

    `ended` is one of ENDINGS, or "" where it is unknown, as of an imported recording; `code` is that of a trip. `why` is the reason of the
    end, or the damage. "interrupted" means cut off and recovered, "unfinished" going on or cut off. `swings` counts the recordings of a
    pendulum, `motions` those of a mechanism; `named_conditions` are its conditions, and `seconds` their duration in all.
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
    """The entry from the data of `plain`, without a verdict. Raises TypeError or LookupError for anything else."""
    conditions = tuple(LoggedCondition(**one) for one in content["conditions"])
    named = tuple(content["named_conditions"])
    return Entry(**{**content, "conditions": conditions, "named_conditions": named, "verdict": None})
