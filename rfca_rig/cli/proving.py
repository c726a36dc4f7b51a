"""rfca-rig prove"""

from contextlib import redirect_stderr, redirect_stdout
from io import StringIO
from pathlib import Path
from typing import Annotated

import typer

from rfca_rig.cli import diagnosing
from rfca_rig.cli.crews import Cluster, Workers, asked_crew
from rfca_rig.cli.lines import print_lines
from rfca_rig.cli.options import Json, Pdf


def prove(
    out: Annotated[Path, typer.Option("--out", metavar="DIR", help="A new folder, or that of an exam that was stopped.")],
    seed: Annotated[int, typer.Option("--seed", min=0, help="The same seed, the same cases.")] = 1,
    cases: Annotated[
        int | None, typer.Option("--cases", metavar="N", min=1, max=1_000_000, help="How many; 500 of all kinds if not given.")
    ] = None,
    kind: Annotated[str | None, typer.Option("--kind", metavar="KIND", help='Cases of one kind only, as in --kind "two effects".')] = None,
    workers: Workers = None,
    cluster: Cluster = None,
    follows: Annotated[
        bool, typer.Option("--follow-up", help="Then do what is proposed in the open cases, and beside it experiments drawn by lot.")
    ] = False,
    pdf: Pdf = False,
    as_json: Json = False,
) -> None:
    """Examine the diagnosis: campaigns of another simulator, the truth under seal until all are diagnosed, then marks.

    A stopped exam goes on where it stood when the same command is typed again.

    Example: rfca-rig prove --out exam --seed 1 --cases 40
    """
    from rfca_rig.cli.printing import Printing
    from rfca_rig.cli.progress import progress
    from rfca_rig.clock import WallClock
    from rfca_rig.errors import Stopped
    from rfca_rig.exam.examine import examine
    from rfca_rig.exam.follow_up import follow_up
    from rfca_rig.exam.marked import examined
    from rfca_rig.exam.marking import wording
    from rfca_rig.report.exam_files import write_exam

    printing = Printing(pdf)
    numbers = _numbers(cases, kind)
    try:
        with progress(quiet=as_json) as bars, asked_crew(workers, cluster, bars.told, out) as crew:
            examine(out, seed, numbers, diagnose_as_typed, crew, WallClock, bars.told)
            if follows:
                follow_up(out, diagnose_as_typed, crew, bars.told)
    except KeyboardInterrupt:
        raise Stopped("stopped by the operator; the same command goes on where it stood") from None
    result = examined(out)
    write_exam(result, out)
    if as_json:
        typer.echo((out / "exam.json").read_text(encoding="utf-8"), nl=False)
    else:
        print_lines([*wording(result.marks), *(way.words for way in result.ways)])
        typer.echo(f"{out / 'exam.html'}: the whole result", err=True)
    printing.print([out / "exam.html"], as_json)


def diagnose_as_typed(campaign: Path, into: Path) -> None:
    """The command `rfca-rig diagnose` itself, what it prints unheard."""
    with redirect_stdout(StringIO()), redirect_stderr(StringIO()):
        diagnosing.diagnose([campaign], into)


def _numbers(cases: int | None, kind: str | None) -> dict[str, int]:
    from rfca_rig.errors import BadInput
    from rfca_rig.exam.cases import DEFAULT_NUMBERS, KINDS, shared_out
    from rfca_rig.nearest import suggestion

    if kind is None:
        return dict(DEFAULT_NUMBERS) if cases is None else shared_out(cases)
    if kind not in KINDS:
        raise BadInput(f"--kind {kind!r} is unknown; {suggestion(kind, map(repr, KINDS))}")
    return {kind: DEFAULT_NUMBERS[kind] if cases is None else cases}
