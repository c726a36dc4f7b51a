"""rfca-rig diagnose"""

import json
from collections.abc import Callable, Iterable, Sequence
from contextlib import redirect_stderr, redirect_stdout
from dataclasses import dataclass, replace
from functools import partial
from io import StringIO
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from rfca_rig.cli.options import (
    AllowOutside,
    AsIs,
    Cluster,
    Figures,
    Json,
    Pdf,
    Rig,
    Runs,
    Seed,
    Workers,
    open_executor,
    out_folder,
)
from rfca_rig.cli.terminal import echo
from rfca_rig.escaping import json_text
from rfca_rig.progress import ProgressReport

if TYPE_CHECKING:
    from rfca_rig.cli.close_the_loop import ClosedLoop
    from rfca_rig.diagnosis.problem import Problem
    from rfca_rig.diagnosis.result import Diagnosis
    from rfca_rig.executors.mapping import TaskExecutor
    from rfca_rig.model.effect import Declaration
    from rfca_rig.protocol.plan import Limits


ANSWER = "diagnosis.json"

Job = Callable[[tuple[Path, Path]], str | None]


def diagnose_each(
    paths: Sequence[Path],
    out: Path,
    job: Job,
    workers: int | None,
    cluster: str | None,
    as_json: bool,
) -> None:
    """A folder for each path under `out`; an existing one stays. Raises RigError where some could
    not be diagnosed.

    `job` makes one diagnosis of (recordings, folder), and returns the reason where the recordings
    cannot be used.
    """
    from rfca_rig.cli.progress import progress
    from rfca_rig.errors import RigError, Stopped
    from rfca_rig.recording.atomic import refresh_nfs_cache, remove_leftovers

    folders = _folders(paths, out)
    out.mkdir(parents=True, exist_ok=True)
    remove_leftovers(out)
    try:
        with (
            progress(quiet=as_json) as bars,
            open_executor(workers, cluster, bars.report, out) as executor,
        ):
            failed = _diagnose_all(folders, job, executor, bars.report)
    except KeyboardInterrupt:
        raise Stopped("stopped by the operator; the same command goes on where it stood") from None
    # Workers on other computers wrote the answers; this computer may not see the new folders yet.
    refresh_nfs_cache(out)
    answers = {
        name: json.loads((out / name / ANSWER).read_text(encoding="utf-8"))
        for name in folders
        if name not in failed
    }
    if as_json:
        echo(json.dumps(answers, indent=1))
    else:
        for name, answer in answers.items():
            echo(f"{name}: {_in_words(answer)}")
    if failed:
        name, why = min(failed.items())
        raise RigError(f"{len(failed)} of {len(folders)} could not be diagnosed, as {name}: {why}")


def _folders(paths: Sequence[Path], out: Path) -> dict[str, tuple[Path, Path]]:
    """For each name the path of its recordings, and the folder of its diagnosis."""
    from rfca_rig.errors import BadInput

    folders: dict[str, tuple[Path, Path]] = {}
    for path in paths:
        if path.is_file():
            name = path.resolve().parent.name
        else:
            name = path.resolve().name
        if name in folders:
            raise BadInput(
                f"{path}: {folders[name][0]} is called {name} too, and --each gives a "
                "folder to each name; rename one of them"
            )
        folders[name] = (path.resolve(), out.resolve() / name)
    return folders


def _diagnose_all(
    folders: dict[str, tuple[Path, Path]],
    job: Job,
    executor: "TaskExecutor",
    report_progress: ProgressReport,
) -> dict[str, str]:
    """Diagnoses what is missing; returns the reason, by name, for each that failed."""
    from rfca_rig.executors.mapping import TaskFailure, map_unordered

    to_do = [pair for pair in folders.values() if not (pair[1] / ANSWER).is_file()]
    before = len(folders) - len(to_do)
    failed: dict[str, str] = {}
    report_progress("diagnoses", before, len(folders))
    for number, ((_, into), result) in enumerate(
        map_unordered(executor, job, to_do), start=before + 1
    ):
        why = result.reason if isinstance(result, TaskFailure) else result
        if why is not None:
            failed[into.name] = why
        report_progress("diagnoses", number, len(folders))
    return failed


def _in_words(answer: dict[str, Any]) -> str:
    named = [
        f"{effect['id']} ({100.0 * effect['probability']:.1f} %)" for effect in answer["effects"]
    ]
    # Files of rfca-diagnosis/1 have no grades.
    return ", ".join([answer.get("grade", answer["verdict"]), *named])


def _list_effects(wanted: bool) -> None:
    """The effects of legs, those of mechanisms, and changes of values, with what each is."""
    if not wanted:
        return
    from rfca_rig.cli.terminal import print_lines
    from rfca_rig.model.catalogue import catalogue
    from rfca_rig.model.declarations import MECHANISM
    from rfca_rig.model.declarations.changes import CHANGES

    def describe(effects: Iterable["Declaration"]) -> list[str]:
        return [
            f"{effect.id:<30}{effect.left_out}"
            for effect in sorted(effects, key=lambda effect: effect.id)
        ]

    print_lines(describe(catalogue().values()), indent=" " * 30)
    print_lines(["", "Of mechanisms and pendulums, as far as the model has a place for them:"])
    print_lines(describe(MECHANISM), indent=" " * 30)
    print_lines(["", "Of a leg beside a reference (--reference), as far as [known_to] has them:"])
    print_lines(describe(CHANGES.values()), indent=" " * 30)
    raise typer.Exit


def diagnose(
    paths: Annotated[
        list[Path],
        typer.Argument(
            metavar="PATH",
            help=(
                "Campaign folders, imported or run folders, .h5 files; or one with experiment.toml."
            ),
        ),
    ],
    out: Annotated[
        Path,
        typer.Option(
            "--out",
            metavar="DIR",
            callback=out_folder,
            help="Folder for diagnosis.html, .json, model.toml, next-experiment.toml.",
        ),
    ] = Path("diagnosis"),
    close_the_loop: Annotated[
        bool,
        typer.Option(
            "--close-the-loop",
            help="Run the proposed experiment on --rig and diagnose again, until nothing is open.",
        ),
    ] = False,
    each: Annotated[
        bool,
        typer.Option(
            "--each",
            help=(
                "A diagnosis of each PATH by itself, in a folder of its name; those that are "
                "there stay."
            ),
        ),
    ] = False,
    without: Annotated[
        list[str] | None,
        typer.Option(
            "--without",
            metavar="EFFECT",
            help="An effect (--list) that you know is none; may be given again.",
        ),
    ] = None,
    lists: Annotated[  # noqa: ARG001
        bool,
        typer.Option(
            "--list",
            callback=_list_effects,
            is_eager=True,
            help="Print all effects that are looked for, and leave.",
        ),
    ] = False,
    reference: Annotated[
        list[Path] | None,
        typer.Option(
            "--reference",
            metavar="OLD",
            help="Earlier recordings of the same rig: find what has changed since then; runs of "
            "one leg may be several.",
        ),
    ] = None,
    law: Annotated[
        str,
        typer.Option(
            "--law",
            metavar="PLACE",
            help="Also measure the law there: hinges, floor_friction, floor_normal, fy_N, "
            "fz_N, tx_Nm; of a mechanism or a pendulum a JOINT, JOINT.speed or JOINT.position.",
        ),
    ] = "",
    workers: Workers = None,
    cluster: Cluster = None,
    rig: Rig = "twin",
    rounds: Annotated[
        int,
        typer.Option(
            "--rounds", metavar="N", min=1, help="How many experiments --close-the-loop may run."
        ),
    ] = 3,
    runs: Runs = Path("runs"),
    seed: Seed = None,
    minutes: Annotated[
        float | None,
        typer.Option(
            "--minutes",
            metavar="N",
            min=0.1,
            help="Time for the search; the answer is then the best so far.",
        ),
    ] = None,
    reveals: Annotated[
        bool,
        typer.Option(
            "--reveal",
            help="At the end say what the twin was concealing (twin conceal), and whether it was "
            "found.",
        ),
    ] = False,
    as_is: AsIs = False,
    allow_outside: AllowOutside = False,
    pdf: Pdf = False,
    figures: Figures = False,
    as_json: Json = False,
) -> None:
    """Find where model and recordings differ, which physics the model omits, and how sure that is.

    Example: rfca-rig diagnose runs/SIM-table-ii-001 --out diagnosis
    """
    from rfca_rig.cli.options import PageCopies
    from rfca_rig.cli.reveal import describe_reveal, open_concealed
    from rfca_rig.diagnosis.config import check_known_of_any_rig
    from rfca_rig.diagnosis.opening import open_problem
    from rfca_rig.diagnosis.reference.problem import add_reference
    from rfca_rig.errors import BadInput
    from rfca_rig.reports.provenance import command_line

    without_words = [word for effect in without or () for word in ("--without", effect)]
    since: list[str | Path] = [word for path in reference or () for word in ("--reference", path)]
    other_words = [*since, *(["--law", law] if law else []), *(["--as-is"] if as_is else [])]
    if minutes is not None:
        other_words += ["--minutes", f"{minutes:g}"]
    asked = DiagnoseOptions(
        out,
        as_json,
        command_line("diagnose", *paths, *without_words, *other_words),
        tuple(without or ()),
        law_at=law,
        minutes=minutes,
    )
    copies = PageCopies(pdf, figures)
    _check_options(each, close_the_loop, law, pdf or figures)
    _check_reference(bool(reference), each, close_the_loop)
    if each and reveals:
        raise BadInput("--reveal: is about one diagnosis; leave out --each")
    if each and not close_the_loop:
        # Otherwise each diagnosis would refuse the name for itself, after it has read recordings.
        check_known_of_any_rig(asked.without)
        diagnose_each(
            paths,
            out,
            partial(diagnose_quietly, asked.without, as_is, allow_outside, minutes),
            workers,
            cluster,
            as_json,
        )
        return
    if each or workers or cluster:
        raise BadInput(
            "--workers and --cluster share out what --each makes many of; one diagnosis, "
            "or --close-the-loop, stays here"
        )
    problem = open_problem(paths, as_is, allow_outside)
    # First: a seal that cannot be opened must be reported before the work, not after it.
    concealed = open_concealed(problem) if reveals else ()
    if reference:
        problem = add_reference(problem, open_problem(reference, as_is, allow_outside))
    if not close_the_loop:
        diagnosis = diagnose_and_write(problem, asked)
    else:
        from rfca_rig.cli.close_the_loop import ClosedLoop
        from rfca_rig.cli.paths import find_rig

        # The command is stored with the result, without options at their defaults.
        options = {
            "--rig": rig if rig != "twin" else None,
            "--rounds": rounds if rounds != 3 else None,
            "--seed": seed,
            "--as-is": as_is,
        }
        command = command_line(
            "diagnose", *paths, *without_words, "--close-the-loop", options=options
        )
        diagnosis = _in_rounds(
            ClosedLoop(find_rig(rig), rounds, runs, out, seed, as_json),
            problem,
            replace(asked, command=command),
        )
    _say(diagnosis, paths, out, as_json)
    for line in describe_reveal(concealed, diagnosis):
        echo(line, err=as_json)
    copies.make([out / "diagnosis.html"], as_json)


def _check_options(each: bool, close_the_loop: bool, law: str, has_copies: bool) -> None:
    """Raises BadInput for options that do not go together."""
    from rfca_rig.errors import BadInput

    if each and has_copies:
        raise BadInput(
            "--pdf and --figures are of one diagnosis; with --each, diagnose what matters by itself"
        )
    if law and (each or close_the_loop):
        raise BadInput(
            "--law measures the law of one diagnosis; leave out --each and --close-the-loop"
        )


def _check_reference(has_reference: bool, each: bool, close_the_loop: bool) -> None:
    """Raises BadInput for a reference beside an option that does not use it."""
    from rfca_rig.errors import BadInput

    if has_reference and (each or close_the_loop):
        raise BadInput(
            "--reference is that of one diagnosis; leave out --each and --close-the-loop"
        )


def diagnose_quietly(
    without: tuple[str, ...],
    as_is: bool,
    allow_outside: bool,
    minutes: float | None,
    job: tuple[Path, Path],
) -> str | None:
    """One diagnosis without output; returns the reason where the recordings cannot be used."""
    from rfca_rig.errors import RigError
    from rfca_rig.recording.atomic import atomic_directory

    recordings, folder = job
    try:
        # All or nothing: a folder that exists counts as done when the command is typed again.
        with (
            atomic_directory(folder) as into,
            redirect_stdout(StringIO()),
            redirect_stderr(StringIO()),
        ):
            diagnose(
                [recordings],
                into,
                without=list(without),
                minutes=minutes,
                as_is=as_is,
                allow_outside=allow_outside,
            )
    except RigError as error:
        return str(error)
    return None


def _say(diagnosis: "Diagnosis", paths: Sequence[Path], out: Path, as_json: bool) -> None:
    """Prints the result in the terminal."""
    from rfca_rig.diagnosis.experiment_design.leg_experiment import NEXT_PROTOCOL
    from rfca_rig.diagnosis.leg.problem import MODEL
    from rfca_rig.reports.diagnosis.files import terminal_lines
    from rfca_rig.reports.diagnosis.opening import name_comparison

    if as_json:
        echo(json_text((out / "diagnosis.json").read_text(encoding="utf-8")), nl=False)
        return
    for line in terminal_lines(diagnosis):
        echo(line)
    echo(f"{out / 'diagnosis.html'}: the whole answer", err=True)
    recordings = [str(path) for path in paths]
    if command := name_comparison(diagnosis, recordings, str(out / MODEL)):
        echo(f"the recordings beside the new model: {command}", err=True)
    # The command for the proposed experiment, where the rig can do it.
    proposal = diagnosis.next_experiment
    if (
        proposal is not None
        and proposal["protocol"] is not None
        and proposal["kind"] in ("dynamic", "static")
    ):
        echo(
            (
                f"next: rfca-rig {proposal['kind']} run --protocol {out / NEXT_PROTOCOL}, on "
                "the rig of these recordings"
            ),
            err=True,
        )


@dataclass(frozen=True)
class DiagnoseOptions:
    """Folder of the result, the command as typed, effects that are excluded, and the place of a
    measured law.

    `limits` are those of the rig on which further experiments may run, `minutes` the time for a
    search.
    """

    out: Path
    quiet: bool
    command: str
    without: tuple[str, ...]
    limits: "Limits | None" = None
    law_at: str = ""
    minutes: float | None = None


def _in_rounds(loop: "ClosedLoop", problem: "Problem", asked: DiagnoseOptions) -> "Diagnosis":
    """The last diagnosis, after the proposed experiments."""
    from rfca_rig.cli.close_the_loop import close_the_loop
    from rfca_rig.description.rig_file import read_rig

    within = replace(asked, limits=read_rig(loop.rig_path).facts().limits)
    return close_the_loop(loop, problem, lambda grown: diagnose_and_write(grown, within))


def diagnose_and_write(problem: "Problem", asked: DiagnoseOptions) -> "Diagnosis":
    """Diagnoses recordings and writes all files."""
    from rfca_rig.cli.progress import progress
    from rfca_rig.clock import WallClock
    from rfca_rig.diagnosis.budget import allow_minutes
    from rfca_rig.diagnosis.diagnose import diagnose as diagnose_problem
    from rfca_rig.reports.diagnosis.files import write_diagnosis
    from rfca_rig.reports.problems import origin_of_problem

    with progress(asked.quiet) as bars:
        answer = diagnose_problem(
            problem,
            bars.share,
            asked.without,
            asked.law_at,
            asked.limits,
            allow_minutes(WallClock(), asked.minutes),
        )
    write_diagnosis(answer.diagnosis, asked.out, origin_of_problem(problem, asked.command))
    for line in answer.write_files(asked.out):
        echo(line, err=True)
    return answer.diagnosis
