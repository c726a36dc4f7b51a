"""rfca-rig reference set, show, clear and history: the runs with which later ones are compared."""

import json
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from rfca_rig.cli.options import Command, Figures, Json, PageCopies, out_folder
from rfca_rig.cli.terminal import echo
from rfca_rig.errors import BadInput, RigError

if TYPE_CHECKING:
    from rfca_rig.diagnosis.problem import Problem
    from rfca_rig.diagnosis.result import Value
    from rfca_rig.logbook.entry import Entry
    from rfca_rig.logbook.references import ReferenceSection
    from rfca_rig.reports.history.result import RigHistory, TrackedRun

app = typer.Typer(
    help="Runs from when all was well: later runs are compared with them.", no_args_is_help=True
)
FEWEST_RUNS = 2


@app.command("set", cls=Command)
def set_runs(
    runs: Annotated[
        list[Path], typer.Argument(metavar="RUN...", help="Folders of runs, beside each other.")
    ],
) -> None:
    """Make runs the reference of their rig and sample. dynamic run and check then say what has
    changed since.

    Name two runs or more of the same conditions: from them the comparison learns how much runs
    differ anyway.

    Example: rfca-rig reference set runs/REAL-test-001 runs/REAL-test-002
    """
    from rfca_rig.diagnosis.opening import open_problem
    from rfca_rig.logbook.references import make_reference, set_reference

    section = make_reference(runs)
    # A reference that cannot be read would only be noticed at the end of the next run.
    open_problem(runs).list_effects()
    set_reference(runs)
    echo(f"reference of {section.identity.words()}: {', '.join(section.runs)}", err=True)
    if len(section.runs) < FEWEST_RUNS:
        echo(
            "one run does not show how much runs differ anyway, and small changes are not stated; "
            "record the same conditions again and name both",
            err=True,
        )


@app.command(cls=Command)
def show(
    runs: Annotated[
        Path, typer.Argument(metavar="RUNS", help="The folder in which the runs lie.")
    ] = Path("runs"),
    as_json: Json = False,
) -> None:
    """Show which runs are the reference of each rig.

    Example: rfca-rig reference show runs
    """
    from rfca_rig.logbook.references import read_references

    references = read_references(runs)
    if as_json:
        echo(json.dumps([reference.model_dump() for reference in references], indent=1))
        return
    for reference in references:
        echo(f"{reference.identity.words()}: {', '.join(reference.runs)}")
    if not references:
        echo(f"{runs}: has no reference; rfca-rig reference set RUN names one", err=True)


@app.command(cls=Command)
def clear(
    run: Annotated[Path, typer.Argument(metavar="RUN", help="The folder of a run.")],
) -> None:
    """Forget the reference of a run's rig and sample; the runs stay.

    Example: rfca-rig reference clear runs/REAL-test-001
    """
    from rfca_rig.logbook.references import clear_reference

    section = clear_reference(run)
    if section is None:
        echo(f"{run}: its rig has no reference", err=True)
    else:
        echo(f"no longer a reference: {', '.join(section.runs)}", err=True)


@app.command(cls=Command)
def history(
    runs: Annotated[
        Path, typer.Argument(metavar="RUNS", help="The folder in which the runs lie.")
    ] = Path("runs"),
    rig: Annotated[
        str, typer.Option("--rig", metavar="NAME", help="Which rig, where several have one.")
    ] = "",
    sample: Annotated[
        str, typer.Option("--sample", metavar="NAME", help="Which specimen on it.")
    ] = "",
    out: Annotated[
        Path,
        typer.Option(
            "--out",
            metavar="DIR",
            callback=out_folder,
            help="Folder for history.html, .csv and .json.",
        ),
    ] = Path("history"),
    figures: Figures = False,
    as_json: Json = False,
) -> None:
    """Show how the values of a rig have changed since its reference, run by run: stiffness,
    friction, zero, with intervals and trends.

    Example: rfca-rig reference history runs --out history
    """
    from rfca_rig.reports.history.page import HTML, write_history
    from rfca_rig.reports.provenance import command_line

    reference = _choose_reference(runs, rig, sample)
    found = _track(runs, reference, as_json)
    options = {"--rig": rig or None, "--sample": sample or None, "--out": out}
    write_history(found, out, command_line("reference", "history", runs, options=options))
    if as_json:
        echo(json.dumps(found.plain(), indent=1))
        return
    PageCopies(pdf=False, figures=figures).make([out / HTML], as_json)
    echo(found.sentence())
    for folder, why in found.left_out:
        echo(f"left out {folder}: {why}", err=True)
    echo(f"next: open {out / HTML}", err=True)


def _choose_reference(runs: Path, rig: str, sample: str) -> "ReferenceSection":
    """The reference of this rig in a folder, or the only one. Raises BadInput."""
    from rfca_rig.logbook.references import read_references

    references = read_references(runs)
    wanted = [
        reference
        for reference in references
        if (not rig or reference.rig == rig) and (not sample or reference.sample == sample)
    ]
    if len(wanted) == 1:
        return wanted[0]
    if not references:
        raise BadInput(f"{runs}: has no reference; rfca-rig reference set RUN names one")
    listed = "; ".join(reference.identity.words() for reference in references)
    raise BadInput(f"{runs}: has references of {listed}; choose one with --rig and --sample")


def _track(runs: Path, reference: "ReferenceSection", quiet: bool) -> "RigHistory":
    """The history of the rig of a reference. Raises BadInput where it has no run to compare."""
    from rfca_rig.cli.progress import progress
    from rfca_rig.diagnosis.opening import open_problem
    from rfca_rig.executors.cores import cores
    from rfca_rig.executors.parallel import map_in_processes
    from rfca_rig.reports.history.result import RigHistory, TrackedRun

    entries = _list_later_runs(runs, reference)
    # Opened once: copies of the process have it in memory.
    opened = open_problem([runs / name for name in reference.runs])
    tracked = []
    left_out = []
    size = cores()
    with progress(quiet) as bars:
        for first in range(0, len(entries), size):
            bars.share("comparing runs", first / len(entries))
            block = entries[first : first + size]
            tasks = [(runs / entry.folder, opened) for entry in block]
            for entry, answer in zip(block, map_in_processes(_track_run, tasks), strict=True):
                if isinstance(answer, str):
                    left_out.append((entry.folder, answer))
                else:
                    tracked.append(TrackedRun(entry.folder, entry.began_s, answer))
    if not tracked:
        why = f"; {left_out[0][0]}: {left_out[0][1]}" if left_out else ""
        raise BadInput(f"{runs}: no later run of {reference.identity.words()} to compare{why}")
    return RigHistory(
        reference.identity.words(),
        reference.runs,
        _list_units(tracked),
        tuple(tracked),
        tuple(left_out),
    )


def _list_units(tracked: "Sequence[TrackedRun]") -> dict[str, str]:
    """Units of the values that all runs have: those with other nominal values may track others."""
    from rfca_rig.analysis.fitting.parameters import PARAMETERS
    from rfca_rig.reports.history.result import PERCENT

    names = set(tracked[0].changes).intersection(*(run.changes for run in tracked))
    units = {}
    for name in tracked[0].changes:
        parameter = PARAMETERS[name]
        if name in names:
            units[name] = PERCENT if parameter.relative else parameter.unit
    return units


def _list_later_runs(runs: Path, reference: "ReferenceSection") -> "list[Entry]":
    """The runs of the reference's rig that are no part of it, in the order of time."""
    from rfca_rig.logbook.listing import find_runs
    from rfca_rig.logbook.reading import read_entry
    from rfca_rig.logbook.references import identify_rig

    entries = []
    for found in find_runs(runs):
        if found.folder in reference.runs:
            continue
        try:
            if identify_rig(runs / found.folder) == reference.identity:
                entries.append(read_entry(runs, found.folder))
        # A damaged folder is no reason to hide the others; rfca-rig check names it.
        except BadInput:
            continue
    return sorted(entries, key=lambda entry: entry.began_s)


def _track_run(task: "tuple[Path, Problem]") -> "dict[str, Value] | str":
    """The changes in one run, or why it cannot be compared."""
    from rfca_rig.diagnosis.opening import open_problem
    from rfca_rig.diagnosis.reference.history import track_changes
    from rfca_rig.diagnosis.reference.problem import ReferenceProblem
    from rfca_rig.progress import ignore_share

    run, reference = task
    try:
        problem = ReferenceProblem(open_problem([run]), reference)
        return dict(track_changes(problem, ignore_share))
    except RigError as error:
        return str(error)
