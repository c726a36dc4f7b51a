"""rfca-rig sweep"""

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from rfca_rig.cli.options import Cluster, Figures, Json, Model, PageCopies, Workers
from rfca_rig.cli.terminal import echo
from rfca_rig.escaping import json_text

if TYPE_CHECKING:
    from rfca_rig.clock import Clock
    from rfca_rig.model.parameters import RigModel
    from rfca_rig.sweep.plan import SweepPlan
    from rfca_rig.sweep.result import SweepResult


HELP_VARY = (
    "A grid, NAME=FROM:TO:STEPS[:log] or NAME=A,B,C; with --samples a range, "
    "NAME=FROM:TO[:log]. May be given several times."
)


def sweep(
    file: Annotated[
        str | None,
        typer.Argument(
            metavar="SWEEP", help="A sweep: a name in sweeps/ (--list), or a .toml file."
        ),
    ] = None,
    vary: Annotated[
        list[str] | None, typer.Option("--vary", metavar="NAME=...", help=HELP_VARY)
    ] = None,
    fixed: Annotated[
        list[str] | None,
        typer.Option(
            "--set", metavar="NAME=VALUE", help="A value for all cases. May be given several times."
        ),
    ] = None,
    outputs: Annotated[
        str,
        typer.Option(
            "--outputs", metavar="NAME,...", help="What to put out; --list prints all there are."
        ),
    ] = "",
    samples: Annotated[
        int | None,
        typer.Option(
            "--samples", metavar="N", min=2, help="So many points spread over the ranges."
        ),
    ] = None,
    method: Annotated[
        str, typer.Option("--method", metavar="KIND", help="How they are spread: sobol or latin.")
    ] = "sobol",
    seed: Annotated[
        int, typer.Option("--seed", metavar="N", min=0, help="The same seed, the same points.")
    ] = 0,
    rig: Annotated[
        str | None,
        typer.Option(
            "--rig",
            metavar="NAME|FILE",
            help="The rig: a name in calibration/ (plan --list), or a .toml file.",
        ),
    ] = None,
    model: Model = None,
    out: Annotated[
        Path | None,
        typer.Option(
            "--out", metavar="DIR", help="A new folder, or that of a sweep that was stopped."
        ),
    ] = None,
    workers: Workers = None,
    cluster: Cluster = None,
    dry_run: Annotated[
        bool,
        typer.Option(
            "--dry-run", help="How many cases, how long, how many bytes; computes a few only."
        ),
    ] = False,
    lists: Annotated[
        bool,
        typer.Option(
            "--list",
            help="Print the sweeps in sweeps/, what can be varied and what can be put out.",
        ),
    ] = False,
    figures: Figures = False,
    as_json: Json = False,
) -> None:
    """Design questions: any parameters of the model over grids or samples, any outputs, to CSV,
    HDF5 and a page of figures.

    A stopped sweep goes on where it stood when the same command is typed again.

    Example: rfca-rig sweep --vary height_mm=195:255:13 --outputs energy_J
    """
    from rfca_rig.clock import WallClock
    from rfca_rig.errors import Stopped

    if lists:
        _print_lists()
        return
    plan, command = _plan_and_command(
        file, vary or [], fixed or [], outputs, samples, method, seed, rig, model
    )
    if dry_run:
        _print_estimate(plan, workers, as_json)
        return
    if out is not None:
        folder = out
    elif file:
        folder = Path(Path(file).stem)
    else:
        folder = Path("sweep")
    try:
        result = _run_sweep(plan, folder, workers, cluster, quiet=as_json, clocks=WallClock)
    # Completed cases are on disk, so the same command continues.
    except KeyboardInterrupt:
        raise Stopped("stopped by the operator; the same command goes on where it stood") from None
    page = _report(result, folder, [*command, "--out", folder], as_json)
    PageCopies(pdf=False, figures=figures).make([page], as_json)


def _plan_and_command(
    file: str | None,
    vary: list[str],
    fixed: list[str],
    outputs: str,
    samples: int | None,
    method: str,
    seed: int,
    rig: str | None,
    model: Path | None,
) -> "tuple[SweepPlan, list[str | Path]]":
    """The plan, and the words of the command that repeats it."""
    from rfca_rig.errors import BadInput
    from rfca_rig.sweep.sweep_file import plan_from_options

    if file is not None:
        # Two sources of one setting would leave open which one holds.
        if vary or fixed or outputs or samples or rig or model:
            raise BadInput(
                f"{file} says what is varied; leave --vary, --set, --outputs, --samples, "
                "--rig and --model out, or edit a copy"
            )
        return _of_file(file)
    plan = plan_from_options(_model(rig, model), vary, fixed, outputs, samples, method, seed)
    words: list[str | Path] = ["sweep"]
    for option, given in (("--vary", vary), ("--set", fixed)):
        for text in given:
            words += [option, text]
    if samples is not None:
        words += ["--samples", f"{samples}", "--method", method, "--seed", f"{seed}"]
    if outputs:
        words += ["--outputs", outputs]
    if rig:
        words += ["--rig", rig]
    if model:
        words += ["--model", model]
    return plan, words


def _of_file(name: str) -> "tuple[SweepPlan, list[str | Path]]":
    from rfca_rig.cli.paths import find_file
    from rfca_rig.sweep.sweep_file import make_plan, read_sweep

    path = find_file("sweeps", name)
    content = read_sweep(path)
    # Paths in a sweep file are relative to the file; plain names are looked up as on the command
    # line.
    if content.rig is None or not _is_path(content.rig):
        rig = content.rig
    else:
        rig = str(path.parent / content.rig)
    model = None
    if content.model is not None:
        model = path.parent / content.model
    source: str | Path = name
    if _is_path(name):
        source = path
    return make_plan(content, _model(rig, model), path), ["sweep", source]


def _is_path(name: str) -> bool:
    return name.endswith(".toml") or "/" in name


def _model(rig: str | None, model: Path | None) -> "RigModel":
    from rfca_rig.cli.paths import find_rig
    from rfca_rig.description.model_file import read_model_file
    from rfca_rig.description.rig_file import read_rig
    from rfca_rig.errors import BadInput

    if rig and model:
        raise BadInput("--rig and --model both say which model; name one of them")
    if model:
        return read_model_file(model).model()
    return read_rig(find_rig(rig or "twin")).model()


def _run_sweep(
    plan: "SweepPlan",
    folder: Path,
    workers: int | None,
    cluster: str | None,
    quiet: bool,
    clocks: "Callable[[], Clock]",
) -> "SweepResult":
    from rfca_rig.cli.options import open_executor
    from rfca_rig.cli.progress import progress
    from rfca_rig.model.kernel.compiled import is_warm
    from rfca_rig.sweep.carrying_out import run_sweep

    if not is_warm() and not quiet:
        echo("compiling the model, once on this machine, about ten seconds ...", err=True)
    with progress(quiet) as bars, open_executor(workers, cluster, bars.report) as executor:
        return run_sweep(plan, folder, executor, clocks, bars.report)


def _report(result: "SweepResult", folder: Path, command: list[str | Path], as_json: bool) -> Path:
    """Writes the page and says what was found; its path."""
    from rfca_rig.reports.provenance import command_line
    from rfca_rig.reports.sweep.page import HTML, JSON, lines, write_summary

    write_summary(result, folder, command_line(*command))
    if as_json:
        echo(json_text((folder / JSON).read_text(encoding="utf-8")), nl=False)
        return folder / HTML
    for line in lines(result):
        echo(line)
    echo(f"{folder / HTML}: figures and definitions; all cases in sweep.csv and sweep.h5", err=True)
    return folder / HTML


def _print_estimate(plan: "SweepPlan", workers: int | None, as_json: bool) -> None:
    import json

    from rfca_rig.clock import WallClock
    from rfca_rig.executors.cores import machine_cores
    from rfca_rig.sweep.carrying_out import estimate_bytes, measure_pace

    processes = workers or machine_cores()
    pace = measure_pace(plan, WallClock())
    # Cases are independent, so the time is divided by the number of processes.
    seconds = plan.count * pace.seconds_per_case / processes
    if as_json:
        estimate = {
            "cases": plan.count,
            "seconds_per_case": pace.seconds_per_case,
            "workers": processes,
            "seconds": seconds,
        }
        echo(
            json.dumps(
                {
                    **estimate,
                    "bytes": estimate_bytes(plan),
                    "cases_per_shard": pace.cases_per_shard,
                },
                indent=1,
            )
        )
        return
    echo(f"{plan.title}: {plan.count} cases of {', '.join(plan.varied)}")
    size = f"{1e-6 * estimate_bytes(plan):.1f} MB"
    echo(
        f"about {1e3 * pace.seconds_per_case:.1f} ms each, {_duration(seconds)} on "
        f"{processes} cores; {size}"
    )


def _duration(seconds: float) -> str:
    if seconds < 90.0:
        return f"{seconds:.0f} s"
    if seconds < 5400.0:
        return f"{seconds / 60:.0f} min"
    return f"{seconds / 3600:.1f} h"


def _print_lists() -> None:
    from rfca_rig.cli.names import file_names
    from rfca_rig.sweep.outputs import ANGLE_SEPARATOR, OUTPUTS
    from rfca_rig.sweep.quantities import list_quantities

    echo(f"sweeps: {', '.join(file_names('sweeps'))}")
    echo("what can be varied, also under its name in fit or in a model file:")
    for item in list_quantities().values():
        text = f"  {item.name}: {item.words}"
        if item.choices:
            text += f"; {', '.join(item.choices)}"
        echo(text)
    echo("what can be put out:")
    for output in OUTPUTS.values():
        name = output.name
        if output.at:
            name += f"{ANGLE_SEPARATOR}ANGLE"
        echo(f"  {name}: {output.words} = {output.equation} [{output.source}]")
