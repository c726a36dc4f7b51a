"""rfca-rig prove"""

from contextlib import redirect_stderr, redirect_stdout
from io import StringIO
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from rfca_rig.cli.commands import diagnose
from rfca_rig.cli.names import CASE_KINDS
from rfca_rig.cli.options import Cluster, Figures, Json, Pdf, Workers, open_executor
from rfca_rig.cli.terminal import echo, print_lines
from rfca_rig.escaping import json_text

if TYPE_CHECKING:
    from rfca_rig.exam.scored import ExamResult


def prove(
    out: Annotated[
        Path,
        typer.Option(
            "--out", metavar="DIR", help="A new folder, or that of an exam that was stopped."
        ),
    ],
    seed: Annotated[
        int, typer.Option("--seed", metavar="N", min=0, help="The same seed, the same cases.")
    ] = 1,
    cases: Annotated[
        int | None,
        typer.Option(
            "--cases",
            metavar="N",
            min=1,
            max=1_000_000,
            help="How many; the usual number of each kind if not given.",
        ),
    ] = None,
    kind: Annotated[
        str | None,
        typer.Option(
            "--kind", metavar="KIND", help=f"Cases of one kind only: {'; '.join(CASE_KINDS)}."
        ),
    ] = None,
    workers: Workers = None,
    cluster: Cluster = None,
    follows: Annotated[
        bool,
        typer.Option(
            "--follow-up",
            help=(
                "Then do what is proposed in the open cases, and beside it experiments drawn "
                "at random."
            ),
        ),
    ] = False,
    takes_out: Annotated[
        bool,
        typer.Option(
            "--take-out-each",
            help="Then diagnose each effect that shows once more without it in the catalogue.",
        ),
    ] = False,
    so_far: Annotated[
        bool,
        typer.Option(
            "--so-far",
            help=(
                "Mark what is diagnosed already, and do nothing more; the other truths stay sealed."
            ),
        ),
    ] = False,
    pdf: Pdf = False,
    figures: Figures = False,
    as_json: Json = False,
) -> None:
    """Blind benchmark of the diagnosis: campaigns of another simulator, with hidden ground truth
    until all are diagnosed, then scores.

    A stopped exam goes on where it stood when the same command is typed again.

    Example: rfca-rig prove --out exam --seed 1 --cases 40
    """
    from rfca_rig.cli.options import PageCopies
    from rfca_rig.errors import BadInput, Stopped
    from rfca_rig.exam.scored import score_exam, score_exam_so_far
    from rfca_rig.executors.termination import interrupt_on_termination
    from rfca_rig.reports.exam.page import write_exam

    copies = PageCopies(pdf, figures)
    if so_far and (follows or takes_out):
        raise BadInput(
            "--so-far only marks; leave out --follow-up and --take-out-each, or leave out --so-far"
        )
    try:
        with interrupt_on_termination():
            if so_far:
                result = score_exam_so_far(out)
            else:
                numbers = _numbers(cases, kind)
                _work(out, seed, numbers, workers, cluster, follows, takes_out, as_json)
                result = score_exam(out)
            write_exam(result, out)
            _tell(result, out, as_json)
            copies.make([out / "exam.html"], as_json)
    # Completed cases are on disk, so the same command continues.
    except KeyboardInterrupt:
        raise Stopped("stopped by the operator; the same command goes on where it stood") from None


def _work(
    out: Path,
    seed: int,
    numbers: dict[str, int],
    workers: Workers,
    cluster: Cluster,
    follows: bool,
    takes_out: bool,
    quiet: bool,
) -> None:
    """Runs all cases; then, if asked, follow-ups of open ones, and the ablation of each effect."""
    from rfca_rig.cli.progress import progress
    from rfca_rig.clock import WallClock
    from rfca_rig.exam.examine import examine
    from rfca_rig.exam.follow_up import follow_up, run_ablation

    with (
        progress(quiet=quiet) as bars,
        open_executor(workers, cluster, bars.report, out) as executor,
    ):
        examine(out, seed, numbers, diagnose_as_typed, executor, WallClock, bars.report)
        if follows:
            follow_up(out, diagnose_as_typed, executor, bars.report)
        if takes_out:
            run_ablation(out, diagnose_without, executor, bars.report)


def _tell(result: "ExamResult", out: Path, as_json: bool) -> None:
    from rfca_rig.exam.scoring import format_scores

    if as_json:
        echo(json_text((out / "exam.json").read_text(encoding="utf-8")), nl=False)
        return
    lines = [*format_scores(result.marks), *(way.words for way in result.ways)]
    if result.taken_out:
        lines.append(result.taken_out.words)
    print_lines(lines)
    echo(f"{out / 'exam.html'}: the whole result", err=True)


def diagnose_as_typed(campaign: Path, into: Path, without: list[str] | None = None) -> None:
    """The command `rfca-rig diagnose` itself, without its output."""
    # Many diagnoses run at the same time; their output would be mixed.
    with redirect_stdout(StringIO()), redirect_stderr(StringIO()):
        diagnose.diagnose([campaign], into, without=without)


def diagnose_without(effect: str, campaign: Path, into: Path) -> None:
    """The same with `--without` that effect."""
    diagnose_as_typed(campaign, into, [effect])


def _numbers(cases: int | None, kind: str | None) -> dict[str, int]:
    from rfca_rig.errors import BadInput
    from rfca_rig.exam.cases import DEFAULT_NUMBERS, KINDS, split_numbers
    from rfca_rig.suggestions import suggestion

    if kind is None:
        if cases is None:
            return dict(DEFAULT_NUMBERS)
        return split_numbers(cases)
    if kind not in KINDS:
        raise BadInput(f"--kind {kind!r} is unknown; {suggestion(kind, map(repr, KINDS))}")
    if cases is None:
        return {kind: DEFAULT_NUMBERS[kind]}
    return {kind: cases}
