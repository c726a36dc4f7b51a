"""rfca-rig prove"""

from collections.abc import Callable, Iterator
from contextlib import contextmanager, redirect_stderr, redirect_stdout
from io import StringIO
from pathlib import Path
from typing import Annotated

import typer

from rfca_rig.cli import diagnosing
from rfca_rig.cli.options import Json

LONG_S = 1e4  # cases differ in length: what remains is told from all of them, not from the last half minute


def prove(
    out: Annotated[Path, typer.Option("--out", metavar="DIR", help="A new folder, or that of an exam that was stopped.")],
    seed: Annotated[int, typer.Option("--seed", min=0, help="The same seed, the same cases.")] = 1,
    cases: Annotated[
        int | None, typer.Option("--cases", metavar="N", min=1, max=9999, help="How many; 500 of all kinds if not given.")
    ] = None,
    kind: Annotated[str | None, typer.Option("--kind", metavar="KIND", help='Cases of one kind only, as in --kind "two effects".')] = None,
    workers: Annotated[int, typer.Option("--workers", metavar="N", min=1, max=256, help="Processes, of one thread each.")] = 2,
    follows: Annotated[
        bool, typer.Option("--follow-up", help="Then do what is proposed in the open cases, and beside it experiments drawn by lot.")
    ] = False,
    as_json: Json = False,
) -> None:
    """Examine the diagnosis: campaigns of another simulator, the truth under seal until all are diagnosed, then marks.

    A stopped exam goes on where it stood when the same command is typed again.

    Example: rfca-rig prove --out exam --seed 1 --cases 40
    """
    from rfca_rig.clock import WallClock
    from rfca_rig.errors import Stopped
    from rfca_rig.exam.crew import crew
    from rfca_rig.exam.examine import examine
    from rfca_rig.exam.follow_up import follow_up
    from rfca_rig.exam.marked import examined
    from rfca_rig.exam.marking import wording
    from rfca_rig.report.exam_files import write_exam

    numbers = _numbers(cases, kind)
    try:
        with _bars(quiet=as_json) as told:
            examine(out, seed, numbers, diagnose_as_typed, workers, WallClock, told)
            if follows:
                with crew(workers) as executor:
                    follow_up(out, diagnose_as_typed, executor, told)
    except KeyboardInterrupt:
        raise Stopped("stopped by the operator; the same command goes on where it stood") from None
    result = examined(out)
    write_exam(result, out)
    if as_json:
        typer.echo((out / "exam.json").read_text(encoding="utf-8"), nl=False)
        return
    for line in wording(result.marks):
        typer.echo(line)
    for way in result.ways:
        typer.echo(way.words)
    typer.echo(f"{out / 'exam.html'}: the whole result", err=True)


def diagnose_as_typed(campaign: Path, into: Path) -> None:
    """The command `rfca-rig diagnose` itself, what it prints unheard."""
    with redirect_stdout(StringIO()), redirect_stderr(StringIO()):
        diagnosing.diagnose([campaign], into)


def _numbers(cases: int | None, kind: str | None) -> dict[str, int]:
    from rfca_rig.errors import BadInput
    from rfca_rig.exam.cases import DEFAULT_NUMBERS, KINDS, shared_out

    if kind is None:
        return dict(DEFAULT_NUMBERS) if cases is None else shared_out(cases)
    if kind not in KINDS:
        raise BadInput(f"--kind {kind!r} is unknown; there are {', '.join(map(repr, KINDS))}")
    return {kind: DEFAULT_NUMBERS[kind] if cases is None else cases}


@contextmanager
def _bars(quiet: bool) -> Iterator[Callable[[str, int, int], None]]:
    """A bar for each part of the work, on the error stream; only where a person watches."""
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TaskID, TextColumn, TimeRemainingColumn

    console = Console(stderr=True, quiet=quiet, highlight=False)
    columns = (TextColumn("{task.description:<20}"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    with Progress(*columns, console=console, disable=quiet or not console.is_terminal, speed_estimate_period=LONG_S) as progress:
        tasks: dict[str, TaskID] = {}

        def told(what: str, done: int, of: int) -> None:
            if what not in tasks:
                tasks[what] = progress.add_task(what, total=of, completed=done)
            progress.update(tasks[what], completed=done)

        yield told
