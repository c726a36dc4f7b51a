"""rfca-rig runs"""

import sys
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from rfca_rig.cli.options import Json
from rfca_rig.suggestions import printable

if TYPE_CHECKING:
    from rfca_rig.logbook.entry import Entry

# Rows of the table without --last; --json and --paths then give all.
SHOWN = 20

Ended = Annotated[
    str,
    typer.Option(
        "--ended",
        metavar="HOW",
        help="done, stopped, tripped, worn-out, failed, interrupted, unfinished, damaged; or the code of a trip (rfca-rig trip).",
    ),
]
Verdict = Annotated[
    str,
    typer.Option(
        "--verdict",
        metavar="WHAT",
        help="Of its diagnosis: named, mostly, family, unexplained, nothing-missing, not-enough-data, none; or an effect "
        "(diagnose --list).",
    ),
]


def runs(
    words: Annotated[list[str] | None, typer.Argument(metavar="WORD", help="Words of the title, or of the folder's name.")] = None,
    folder: Annotated[Path, typer.Option("--runs", metavar="DIR", help="The folder that runs and experiments lie below.")] = Path("runs"),
    height: Annotated[str, typer.Option("--height", metavar="MM", help="Recorded at that height: 215, 210..220, ..220, 230..")] = "",
    speed: Annotated[str, typer.Option("--speed", metavar="RAD/S", help="Recorded at that speed: 2.4 is what rounds to it; 2.4..2.5")] = "",
    since: Annotated[str, typer.Option("--since", metavar="DATE", help="Begun then or later: 2026-11-01, or 2026-11-01T14:30")] = "",
    until: Annotated[str, typer.Option("--until", metavar="DATE", help="Begun then or earlier; a day is meant as a whole.")] = "",
    kind: Annotated[str, typer.Option("--kind", metavar="KIND", help="dynamic, static, fatigue, or imported.")] = "",
    source: Annotated[str, typer.Option("--source", metavar="SOURCE", help="SIM, REAL, or IMPORT.")] = "",
    ended: Ended = "",
    verdict: Verdict = "",
    sample: Annotated[str, typer.Option("--sample", metavar="NAME", help="Part of the specimen's name.")] = "",
    operator: Annotated[str, typer.Option("--operator", metavar="NAME", help="Part of the operator's name.")] = "",
    last: Annotated[
        int | None, typer.Option("--last", metavar="N", min=0, help=f"So many of the newest; {SHOWN} in a table if not given, 0 for all.")
    ] = None,
    paths: Annotated[bool, typer.Option("--paths", help="Print only the paths, one a line, as other commands take them.")] = False,
    as_json: Json = False,
) -> None:
    """What has been recorded, newest first: every run below a folder, how it ended, and the verdict of its diagnosis.

    Folders with experiment.toml or pendulum.toml are among them.

    Example: rfca-rig runs --paths --height 215 --kind dynamic --ended done
    """
    import json

    from rfca_rig.campaign.experiment import measure_seconds
    from rfca_rig.cli.names import effect_names
    from rfca_rig.cli.progress import progress
    from rfca_rig.cli.run_table import table_lines
    from rfca_rig.errors import BadInput
    from rfca_rig.logbook import query as asked
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
        entries = list_runs(folder, bars.counting("reading runs"), measure_seconds)
    fitting = [entry for entry in entries if wanted.fits(entry)]
    shown = fitting[: _most(last, is_table=not (paths or as_json))]
    if as_json:
        typer.echo(json.dumps(_as_data(folder, shown), indent=1))
    elif paths:
        # A program gets the paths as they are; on a terminal a name could command it.
        lines = (str(folder / entry.folder) for entry in shown)
        _each(map(_printable, lines) if sys.stdout.isatty() else lines)
    else:
        _each(map(_printable, table_lines(shown)))
        typer.echo(_count_line(folder, len(shown), len(fitting), len(entries)), err=True)


def _most(last: int | None, is_table: bool) -> int | None:
    """Number of runs to show; None for all."""
    if last is None:
        return SHOWN if is_table else None
    # --last 0 means all.
    return last or None


def _each(lines: Iterable[str]) -> None:
    for line in lines:
        typer.echo(line)


def _printable(line: str) -> str:
    """One line, whatever the names of folders hold."""
    return printable(line.replace("\n", "\N{REPLACEMENT CHARACTER}"))


def _as_data(folder: Path, entries: "Sequence[Entry]") -> dict[str, Any]:
    rows = [{"run": str(folder / entry.folder), "began": _moment(entry.began_s), **entry.plain()} for entry in entries]
    return {"format": "rfca-runs/1", "runs": rows}


def _moment(began_s: float) -> str:
    from datetime import datetime

    return datetime.fromtimestamp(began_s).astimezone().isoformat(timespec="seconds")


def _count_line(folder: Path, shown: int, fitting: int, known: int) -> str:
    if not known:
        return f"no runs below {folder} yet; the first: rfca-rig dynamic run --height 215 --speed 2.433"
    if not fitting:
        return f"none of the {known} runs below {folder} is like that; ask for less"
    more = f"; --last 0 shows all {fitting}" if shown < fitting else ""
    return f"{shown} of {known} runs below {folder}{more}"
