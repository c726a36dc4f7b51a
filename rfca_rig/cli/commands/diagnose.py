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
    from rfca_rig.description.sections import AboutSection
    from rfca_rig.diagnosis.result import Diagnosis
    from rfca_rig.executors.mapping import TaskExecutor
    from rfca_rig.mechanism.plant import Plant
    from rfca_rig.model.effect import Declaration
    from rfca_rig.protocol.plan import Limits
    from rfca_rig.recording.model import Recording


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
    """The effects of legs, and those of mechanisms, with what each is."""
    if not wanted:
        return
    from rfca_rig.cli.terminal import print_lines
    from rfca_rig.model.catalogue import catalogue
    from rfca_rig.model.declarations import MECHANISM

    def describe(effects: Iterable["Declaration"]) -> list[str]:
        return [
            f"{effect.id:<30}{effect.left_out}"
            for effect in sorted(effects, key=lambda effect: effect.id)
        ]

    print_lines(describe(catalogue().values()), indent=" " * 30)
    print_lines(["", "Of mechanisms and pendulums, as far as the model has a place for them:"])
    print_lines(describe(MECHANISM), indent=" " * 30)
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
    as_is: AsIs = False,
    allow_outside: AllowOutside = False,
    pdf: Pdf = False,
    as_json: Json = False,
) -> None:
    """Find where model and recordings differ, which physics the model omits, and how sure that is.

    Example: rfca-rig diagnose runs/SIM-table-ii-001 --out diagnosis
    """
    from rfca_rig.campaign.opening import experiment_among, open_with_nominal_model
    from rfca_rig.cli.options import Printing
    from rfca_rig.diagnosis.config import check_known
    from rfca_rig.errors import BadInput
    from rfca_rig.reports.provenance import command_line

    mechanism = experiment_among(paths)
    if mechanism is None:
        # A mechanism has a catalogue of its own, which checks its effects later.
        check_known(without or ())
    known = [word for effect in without or () for word in ("--without", effect)]
    at = [*(["--law", law] if law else []), *(["--as-is"] if as_is else [])]
    command = command_line("diagnose", *paths, *known, *at)
    asked = DiagnoseOptions(
        paths,
        out,
        as_json,
        command,
        tuple(without or ()),
        law_at=law,
        as_is=as_is,
        allow_outside=allow_outside,
    )
    printing = Printing(pdf)
    _check_options(each, close_the_loop, law, pdf)
    if each and not close_the_loop:
        diagnose_each(
            paths,
            out,
            partial(diagnose_quietly, asked.without, as_is, allow_outside),
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
    if mechanism is not None:
        if close_the_loop:
            raise BadInput(
                "--close-the-loop runs experiments on a leg's rig; leave it out for a "
                "mechanism and record the proposed motion"
            )
        diagnosis = _mechanism(asked)
    elif not close_the_loop:
        diagnosis = _diagnose_leg(open_with_nominal_model(paths, as_is, allow_outside), asked)
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
        command = command_line("diagnose", *paths, *known, "--close-the-loop", options=options)
        diagnosis = _in_rounds(
            ClosedLoop(find_rig(rig), rounds, runs, out, seed, as_json),
            replace(asked, command=command),
        )
    _say(diagnosis, out, as_json)
    printing.print([out / "diagnosis.html"], as_json)


def _check_options(each: bool, close_the_loop: bool, law: str, pdf: bool) -> None:
    """Raises BadInput for options that do not go together."""
    from rfca_rig.errors import BadInput

    if each and pdf:
        raise BadInput(
            "--pdf prints one diagnosis; with --each, print the pages that matter by themselves"
        )
    if law and (each or close_the_loop):
        raise BadInput(
            "--law measures the law of one diagnosis; leave out --each and --close-the-loop"
        )


def diagnose_quietly(
    without: tuple[str, ...], as_is: bool, allow_outside: bool, job: tuple[Path, Path]
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
                [recordings], into, without=list(without), as_is=as_is, allow_outside=allow_outside
            )
    except RigError as error:
        return str(error)
    return None


def _say(diagnosis: "Diagnosis", out: Path, as_json: bool) -> None:
    """Prints the result in the terminal."""
    from rfca_rig.diagnosis.experiment_design.leg_experiment import NEXT_PROTOCOL
    from rfca_rig.reports.diagnosis.files import terminal_lines

    if as_json:
        echo(json_text((out / "diagnosis.json").read_text(encoding="utf-8")), nl=False)
        return
    for line in terminal_lines(diagnosis):
        echo(line)
    echo(f"{out / 'diagnosis.html'}: the whole answer", err=True)
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
    """Paths of the recordings, folder of the result, the command as typed, effects that are
    excluded, and the place of a measured law.

    `limits` are those of the rig on which further experiments may run.
    """

    paths: Sequence[Path]
    out: Path
    quiet: bool
    command: str
    without: tuple[str, ...]
    limits: "Limits | None" = None
    law_at: str = ""
    as_is: bool = False
    allow_outside: bool = False


def _in_rounds(loop: "ClosedLoop", asked: DiagnoseOptions) -> "Diagnosis":
    """The last diagnosis, after the proposed experiments."""
    from rfca_rig.campaign.opening import open_with_nominal_model
    from rfca_rig.cli.close_the_loop import close_the_loop
    from rfca_rig.description.rig_file import read_rig

    recordings = open_with_nominal_model(asked.paths, asked.as_is, asked.allow_outside)
    within = replace(asked, limits=read_rig(loop.rig_path).facts().limits)
    return close_the_loop(
        loop,
        recordings,
        _diagnose_leg(recordings, within),
        lambda all_of_them: _diagnose_leg(all_of_them, within),
    )


def _mechanism(asked: DiagnoseOptions) -> "Diagnosis":
    """Diagnosis of a mechanism that MuJoCo simulates, and its model file with the effects found."""
    from rfca_rig.campaign.opening import open_experiment
    from rfca_rig.cli.progress import progress
    from rfca_rig.diagnosis.experiment_design.mechanism_experiment import write_excitation
    from rfca_rig.diagnosis.mechanisms.diagnose import diagnose_mechanism
    from rfca_rig.reports.diagnosis.tables import describe_law, write_law_table

    experiment = open_experiment(asked.paths[0], asked.allow_outside)
    with progress(asked.quiet) as bars:
        outcome = diagnose_mechanism(
            experiment, bars.share, asked.without, asked.law_at, asked.as_is
        )
    diagnosis = _write_imported(outcome.diagnosis, experiment.about, asked)
    _write_plant(outcome.plant, asked.out, "model.xml", "laws.py", outcome.stated)
    measured = [
        asked.out / name for name in ("measured-law.xml", "measured_law.py", "measured-law.csv")
    ]
    if outcome.law is None:
        for path in measured:
            # Of an earlier diagnosis in the same folder, which would look like a result of this
            # one.
            path.unlink(missing_ok=True)
    else:
        law = outcome.law.stated.law
        write_law_table(measured[2], law)
        _write_plant(
            outcome.law.plant,
            asked.out,
            measured[0].name,
            measured[1].name,
            [f"The law of {law.place} over {law.argument}, {describe_law(outcome.law.stated)}."],
        )
    commands = asked.out / "next-commands.csv"
    commands.unlink(missing_ok=True)  # of an earlier diagnosis
    if outcome.excitation is not None:
        write_excitation(commands, outcome.plant.mechanism, outcome.excitation)
        echo(
            f"{commands}: the proposed motion of the joints, and the commands that it takes",
            err=True,
        )
    return diagnosis


def _write_plant(
    plant: "Plant", out: Path, model_name: str, laws_name: str, stated: Sequence[str]
) -> None:
    """Writes the model file, and Python functions for what MJCF cannot express."""
    from rfca_rig.mechanism.laws_file import write_laws
    from rfca_rig.mechanism.model_files import write_amended_model

    beyond = write_amended_model(plant, out / model_name)
    if write_laws(plant, beyond, out / laws_name, stated, model_name):
        echo(
            (
                f"{out / model_name}: MJCF does not hold {', '.join(beyond)}; "
                f"{out / laws_name} does, for your own loop"
            ),
            err=True,
        )


def _write_imported(
    diagnosis: "Diagnosis", about: "AboutSection", asked: DiagnoseOptions
) -> "Diagnosis":
    """Writes the files of a diagnosis of tables from elsewhere."""
    from rfca_rig.diagnosis.result import Diagnosed
    from rfca_rig.recording.layout import identity_of_tables
    from rfca_rig.reports.diagnosis.files import write_diagnosis
    from rfca_rig.reports.provenance import origin_of_import

    (folder,) = asked.paths
    # The identity ties the result to these files, wherever they lie.
    recorded = Diagnosed(diagnosis.title, "IMPORT", identity_of_tables(diagnosis.title, folder))
    diagnosis = replace(diagnosis, recordings=(recorded,))
    write_diagnosis(
        diagnosis, asked.out, origin_of_import(asked.command, folder, diagnosis.title, about)
    )
    return diagnosis


def _diagnose_leg(recordings: "Sequence[Recording]", asked: DiagnoseOptions) -> "Diagnosis":
    """Diagnoses a leg's recordings and writes all files."""
    from rfca_rig.cli.progress import progress
    from rfca_rig.diagnosis.diagnose import diagnose as diagnosed
    from rfca_rig.diagnosis.experiment_design.leg_experiment import write_next_protocol
    from rfca_rig.reports.diagnosis.files import (
        write_diagnosis,
        write_fitted_model,
        write_measured_model,
    )
    from rfca_rig.reports.provenance import origin_of

    with progress(asked.quiet) as bars:
        diagnosis = diagnosed(recordings, bars.share, asked.limits, asked.without, asked.law_at)
    write_diagnosis(diagnosis, asked.out, origin_of(asked.command, asked.paths, recordings))
    write_fitted_model(asked.out / "model.toml", diagnosis, recordings[0])
    write_next_protocol(asked.out, diagnosis.next_experiment)
    measured = asked.out / "measured-law.toml"
    if diagnosis.stated_law is None:
        measured.unlink(missing_ok=True)  # that of an earlier diagnosis
    else:
        write_measured_model(measured, diagnosis.stated_law.law, recordings[0])
    return diagnosis
