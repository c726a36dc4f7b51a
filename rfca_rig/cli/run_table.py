"""The logbook in 80 columns: two lines a run, or three with a diagnosis."""

from collections.abc import Iterable, Iterator, Sequence
from datetime import datetime
from textwrap import wrap

from rfca_rig.logbook.entry import Entry, LoggedCondition

WIDTH = 80
WHEN_WIDTH, ENDED_WIDTH = 16, 11
# What the other two columns, and two gaps of two blanks, leave.
NAME_WIDTH = WIDTH - WHEN_WIDTH - ENDED_WIDTH - 4
INDENT = "    "
MOST_VALUES = 4
WHY_LINES = 2


def table_lines(entries: Sequence[Entry]) -> Iterator[str]:
    """The lines of the table; none without entries."""
    if entries:
        yield _row("run", "begun", "ended")
    for entry in entries:
        yield from _head(entry)
        for text in filter(None, (_describe(entry), _why(entry), _verdict(entry))):
            yield from _wrap(text)


def _wrap(text: str) -> list[str]:
    return wrap(
        text,
        WIDTH,
        initial_indent=INDENT,
        subsequent_indent=2 * INDENT,
        max_lines=WHY_LINES,
        placeholder=" ...",
        break_on_hyphens=False,
    )


def _row(name: str, when: str, ended: str) -> str:
    return f"{name:<{NAME_WIDTH}}  {when:<{WHEN_WIDTH}}  {ended}".rstrip()


def _head(entry: Entry) -> Iterator[str]:
    """A name that is too long gets a line of its own, unbroken, so that it can be copied."""
    when = f"{datetime.fromtimestamp(entry.began_s):%Y-%m-%d %H:%M}"
    # A trip's code says more than the word tripped.
    ended = f"trip {entry.code}" if entry.code else entry.ended
    if len(entry.folder) <= NAME_WIDTH:
        yield _row(entry.folder, when, ended)
    else:
        yield entry.folder
        yield _row("", when, ended)


def _describe(entry: Entry) -> str:
    """What was recorded, under which conditions, of which specimen, by whom."""
    counts = (
        (entry.cycles, "cycle"),
        (entry.strokes, "stroke"),
        (entry.static_stages, "static stage"),
        (entry.swings, "pendulum run"),
        (entry.motions, "recording"),
    )
    what = [f"{count} {name}{'' if count == 1 else 's'}" for count, name in counts if count] or ["nothing whole"]
    people = [text for text in (entry.sample and f"sample {entry.sample}", entry.operator) if text]
    return "; ".join(text for text in (", ".join(what), _conditions(entry.conditions), *_motions(entry), *people) if text)


def _motions(entry: Entry) -> Iterator[str]:
    """Duration and conditions of a mechanism's recordings; only the number of many conditions."""
    if entry.seconds is not None:
        yield f"{entry.seconds:.3g} s"
    elif entry.motions:
        yield "cannot be read, see rfca-rig check"
    if entry.named_conditions:
        few = len(entry.named_conditions) <= MOST_VALUES
        yield f"conditions: {', '.join(entry.named_conditions)}" if few else f"{len(entry.named_conditions)} conditions"


def _conditions(conditions: Sequence[LoggedCondition]) -> str:
    heights = _values((one.height_mm for one in conditions), "mm")
    speeds = _values((one.speed_rad_s for one in conditions if one.speed_rad_s is not None), "rad/s")
    return "; ".join(filter(None, (heights, speeds)))


def _values(values: Iterable[float], unit: str) -> str:
    """Each value once; of many the first and the last."""
    found = sorted(set(values))
    if not found:
        return ""
    text = f"{found[0]:g} to {found[-1]:g}" if len(found) > MOST_VALUES else ", ".join(f"{value:g}" for value in found)
    return f"{text} {unit}"


def _why(entry: Entry) -> str:
    # A run that is done or unfinished needs no explanation.
    return entry.why if entry.ended not in ("", "done", "unfinished") else ""


def _verdict(entry: Entry) -> str:
    if entry.verdict is None:
        return ""
    sure = "" if entry.verdict.probability is None else f" ({100.0 * entry.verdict.probability:.1f} %)"
    named = f": {', '.join(entry.verdict.effects)}{sure}" if entry.verdict.effects else ""
    return f"diagnosis: {entry.verdict.words}{named}; {entry.verdict.file}"
