"""rfca-rig runs, view and trip: what was recorded, a recording in the browser, and what stopped
a run.
"""

import sys
from collections.abc import Iterable, Iterator, Sequence
from datetime import datetime
from pathlib import Path
from textwrap import wrap
from typing import TYPE_CHECKING, Annotated, Any

import typer

from rfca_rig.cli.options import Json
from rfca_rig.cli.terminal import echo
from rfca_rig.escaping import printable
from rfca_rig.logbook.entry import Entry, LoggedCondition
from rfca_rig.recording.layout import LISTENING

if TYPE_CHECKING:
    from rfca_rig.logbook.entry import Entry
import re
from contextlib import suppress

WIDTH = 80
WHEN_WIDTH = 16
ENDED_WIDTH = 11
# What the other two columns, and two gaps of two blanks, leave.
NAME_WIDTH = WIDTH - WHEN_WIDTH - ENDED_WIDTH - 4
INDENT = "    "
MOST_VALUES = 4
WHY_LINES = 2

# Rows of the table without --last; --json and --paths then give all.
SHOWN = 20

Ended = Annotated[
    str,
    typer.Option(
        "--ended",
        metavar="HOW",
        help=(
            "done, stopped, tripped, worn-out, failed, interrupted, unfinished, damaged; or "
            "the code of a trip (rfca-rig trip)."
        ),
    ),
]
Verdict = Annotated[
    str,
    typer.Option(
        "--verdict",
        metavar="WHAT",
        help="Of its diagnosis: named, mostly, family, unexplained, nothing-missing, "
        "not-enough-data, none; or an effect "
        "(diagnose --list).",
    ),
]


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
    ended = entry.ended
    # A trip's code says more than the word tripped.
    if entry.code:
        ended = f"trip {entry.code}"
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
    what = [f"{count} {name}{'' if count == 1 else 's'}" for count, name in counts if count]
    if entry.kind == LISTENING:
        what = ["devices without motion"]
    if not what:
        what = ["nothing whole"]
    people = [text for text in (entry.sample and f"sample {entry.sample}", entry.operator) if text]
    return "; ".join(
        text
        for text in (", ".join(what), _conditions(entry.conditions), *_motions(entry), *people)
        if text
    )


def _motions(entry: Entry) -> Iterator[str]:
    """Duration and conditions of a mechanism's recordings; only the number of many conditions."""
    if entry.seconds is not None:
        yield f"{entry.seconds:.3g} s"
    elif entry.motions:
        yield "cannot be read, see rfca-rig check"
    if len(entry.named_conditions) > MOST_VALUES:
        yield f"{len(entry.named_conditions)} conditions"
    elif entry.named_conditions:
        yield f"conditions: {', '.join(entry.named_conditions)}"


def _conditions(conditions: Sequence[LoggedCondition]) -> str:
    heights = _values((condition.height_mm for condition in conditions), "mm")
    speeds = _values(
        (condition.speed_rad_s for condition in conditions if condition.speed_rad_s is not None),
        "rad/s",
    )
    return "; ".join(filter(None, (heights, speeds)))


def _values(values: Iterable[float], unit: str) -> str:
    """Each value once; of many the first and the last."""
    distinct = sorted(set(values))
    if not distinct:
        return ""
    if len(distinct) > MOST_VALUES:
        text = f"{distinct[0]:g} to {distinct[-1]:g}"
    else:
        text = ", ".join(f"{value:g}" for value in distinct)
    return f"{text} {unit}"


def _why(entry: Entry) -> str:
    # A run that is done or unfinished needs no explanation.
    if entry.ended not in ("", "done", "unfinished"):
        return entry.why
    return ""


def _verdict(entry: Entry) -> str:
    if entry.verdict is None:
        return ""
    if entry.verdict.probability is None:
        sure = ""
    else:
        sure = f" ({100.0 * entry.verdict.probability:.1f} %)"
    if entry.verdict.effects:
        named = f": {', '.join(entry.verdict.effects)}{sure}"
    else:
        named = ""
    return f"diagnosis: {entry.verdict.words}{named}; {entry.verdict.file}"


def runs(
    words: Annotated[
        list[str] | None,
        typer.Argument(metavar="WORD", help="Words of the title, or of the folder's name."),
    ] = None,
    folder: Annotated[
        Path,
        typer.Option(
            "--runs", metavar="DIR", help="The folder that runs and experiments lie below."
        ),
    ] = Path("runs"),
    height: Annotated[
        str,
        typer.Option(
            "--height", metavar="MM", help="Recorded at that height: 215, 210..220, ..220, 230.."
        ),
    ] = "",
    speed: Annotated[
        str,
        typer.Option(
            "--speed",
            metavar="RAD/S",
            help="Recorded at that speed: 2.4 is what rounds to it; 2.4..2.5",
        ),
    ] = "",
    since: Annotated[
        str,
        typer.Option(
            "--since", metavar="DATE", help="Begun then or later: 2026-11-01, or 2026-11-01T14:30"
        ),
    ] = "",
    until: Annotated[
        str,
        typer.Option(
            "--until", metavar="DATE", help="Begun then or earlier; a day is meant as a whole."
        ),
    ] = "",
    kind: Annotated[
        str, typer.Option("--kind", metavar="KIND", help="dynamic, static, fatigue, or imported.")
    ] = "",
    source: Annotated[
        str, typer.Option("--source", metavar="SOURCE", help="SIM, REAL, or IMPORT.")
    ] = "",
    ended: Ended = "",
    verdict: Verdict = "",
    sample: Annotated[
        str, typer.Option("--sample", metavar="NAME", help="Part of the specimen's name.")
    ] = "",
    operator: Annotated[
        str, typer.Option("--operator", metavar="NAME", help="Part of the operator's name.")
    ] = "",
    last: Annotated[
        int | None,
        typer.Option(
            "--last",
            metavar="N",
            min=0,
            help=f"So many of the newest; {SHOWN} in a table if not given, 0 for all.",
        ),
    ] = None,
    paths: Annotated[
        bool,
        typer.Option(
            "--paths", help="Print only the paths, one a line, as other commands take them."
        ),
    ] = False,
    as_json: Json = False,
) -> None:
    """What has been recorded, newest first: every run below a folder, how it ended, and the verdict
    of its diagnosis.

    Folders with experiment.toml or pendulum.toml are among them.

    Example: rfca-rig runs --paths --height 215 --kind dynamic --ended done
    """
    import json

    from rfca_rig.cli.names import effect_names
    from rfca_rig.cli.progress import progress
    from rfca_rig.errors import BadInput
    from rfca_rig.logbook import entry as asked
    from rfca_rig.logbook.listing import list_runs

    if paths and as_json:
        raise BadInput("--paths and --json are two forms of the same answer; give one of them")
    wanted = asked.RunQuery(
        height_mm=asked.span_of(height, "--height") if height else None,
        speed_rad_s=asked.span_of(speed, "--speed") if speed else None,
        began_s=asked.since_until(since, until),
        kind=asked.kind_of(kind),
        source=asked.source_of(source),
        ended=asked.ending_of(ended),
        verdict=asked.verdict_of(verdict, effect_names()),
        sample=sample,
        operator=operator,
        words=tuple(words or ()),
    )
    with progress(quiet=as_json) as bars:
        entries = list_runs(folder, bars.counting("reading runs"), _measure_seconds)
    fitting = [entry for entry in entries if wanted.fits(entry)]
    shown = fitting[: _most(last, is_table=not (paths or as_json))]
    if as_json:
        echo(json.dumps(_as_data(folder, shown), indent=1))
    elif paths:
        lines = [str(folder / entry.folder) for entry in shown]
        # A program gets the paths as they are; on a terminal a name could command it.
        if sys.stdout.isatty():
            lines = [_printable(line) for line in lines]
        _echo_lines(lines)
    else:
        _echo_lines(map(_printable, table_lines(shown)))
        echo(_count_line(folder, len(shown), len(fitting), len(entries)), err=True)


def _measure_seconds(folder: Path) -> float | None:
    """The duration of an experiment's recordings.

    Its reader imports the models, which takes three times as long as listing runs of a leg.
    """
    from rfca_rig.campaign.experiment import measure_seconds

    return measure_seconds(folder)


def _most(last: int | None, is_table: bool) -> int | None:
    """Number of runs to show; None for all."""
    if last is None:
        if is_table:
            return SHOWN
        return None
    # --last 0 means all.
    return last or None


def _echo_lines(lines: Iterable[str]) -> None:
    for line in lines:
        echo(line)


def _printable(line: str) -> str:
    """One line, whatever the names of folders hold."""
    return printable(line.replace("\n", "\N{REPLACEMENT CHARACTER}"))


def _as_data(folder: Path, entries: "Sequence[Entry]") -> dict[str, Any]:
    rows = [
        {"run": str(folder / entry.folder), "began": _moment(entry.began_s), **entry.plain()}
        for entry in entries
    ]
    return {"format": "rfca-runs/1", "runs": rows}


def _moment(began_s: float) -> str:
    from datetime import datetime

    return datetime.fromtimestamp(began_s).astimezone().isoformat(timespec="seconds")


def _count_line(folder: Path, shown: int, fitting: int, known: int) -> str:
    if not known:
        return (
            f"no runs below {folder} yet; the first: rfca-rig dynamic run --height 215 "
            "--speed 2.433"
        )
    if not fitting:
        return f"none of the {known} runs below {folder} is like that; ask for less"
    if shown < fitting:
        more = f"; --last 0 shows all {fitting}"
    else:
        more = ""
    return f"{shown} of {known} runs below {folder}{more}"


def view(
    run: Annotated[
        Path, typer.Argument(metavar="RUN", help="A run's folder, its run.h5, or a campaign.")
    ],
    port: Annotated[
        int,
        typer.Option(
            "--port", metavar="PORT", min=0, max=65535, help="The port; any free one if not given."
        ),
    ] = 0,
) -> None:
    """Play a recording in the browser, on the page on which --view shows a run; ^C ends it.

    Only this computer can open the address that is printed.

    Example: rfca-rig view runs/SIM-table-ii-001
    """
    from rfca_rig.view.run_queue import check_view_is_installed

    check_view_is_installed()
    # After the check: this import needs the packages of the extra.
    from rfca_rig.view.replay import replay

    with suppress(KeyboardInterrupt):
        replay(run, port, lambda url: echo(f"open {url} (^C here ends it)", err=True))


def trip(
    code: Annotated[
        str, typer.Argument(metavar="CODE", help="Such as F-02; without it, all codes are listed.")
    ] = "",
) -> None:
    """Say what a code that stopped a run means: likely causes, how to tell them apart, what to
    change and what not, how to go on.

    Example: rfca-rig trip F-02
    """
    from rfca_rig.errors import BadInput, Trip

    known = [str(member) for member in Trip]
    if not code:
        echo("\n".join(f"{known_code}  {_title(known_code)}" for known_code in known))
        return
    if code.upper() not in known:
        raise BadInput(f"{code}: no code of a trip; known are {', '.join(known)}")
    echo("\n".join(_lines(_page(code.upper()))))


def _lines(page: str) -> list[str]:
    """The page as a terminal shows it: paragraphs and items within 80 columns, without marks and
    links.
    """
    from textwrap import wrap

    # Blocks begin at an empty line, a numbered item or a heading; each is wrapped on its own.
    blocks = re.split(
        r"\n(?=\n|\d\. |# )", re.sub(r" \[All trips\]\(.*?\)|```(text)?\n|\*\*", "", page)
    )
    plain = (re.sub(r"\[(.*?)\]\(.*?\)", r"\1", block).replace("`", "") for block in blocks)
    lines = []
    for block in plain:
        if not block.strip() or block.startswith("\n"):
            lines.append("")
        indent = ""
        if block[:1].isdigit():
            indent = "   "
        lines += wrap(
            " ".join(block.split()), WIDTH, subsequent_indent=indent, break_on_hyphens=False
        )
    return lines


def _title(code: str) -> str:
    """The text behind the code in the page's heading."""
    return _page(code).partition("\n")[0].partition(": ")[2]


def _page(code: str) -> str:
    from rfca_rig.cli.paths import folders_of
    from rfca_rig.errors import BadInput

    for folder in folders_of("docs"):
        page: Path = folder / "trips" / f"{code}.md"
        if page.is_file():
            return page.read_text(encoding="utf-8")
    raise BadInput(
        f"docs/trips/{code}.md did not come with this installation; it is in the "
        "package's repository"
    )
