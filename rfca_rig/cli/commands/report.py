"""rfca-rig report"""

from collections.abc import Mapping, Sequence
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from rfca_rig.cli.options import AllowOutside, AsIs, Json, Model, Pdf, out_folder
from rfca_rig.cli.terminal import echo
from rfca_rig.escaping import json_text

if TYPE_CHECKING:
    from rfca_rig.analysis.compare import Table2
    from rfca_rig.analysis.matched_simulation import Shaft as ShaftName
    from rfca_rig.diagnosis.window_fit import WindowFit
    from rfca_rig.reports.strokes.motions import MotionsReport


class ShaftOption(StrEnum):
    """How the simulated shaft turns."""

    average = "average"
    commanded = "commanded"
    recorded = "recorded"


def report(
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
            help="Folder for report.html, run.html, their tables.",
        ),
    ] = Path("report"),
    shaft: Annotated[
        ShaftOption,
        typer.Option(
            "--shaft",
            metavar="HOW",
            help=(
                "Motion of the shaft to simulate with: average (the mean measured speed, as "
                "in the paper), commanded, recorded."
            ),
        ),
    ] = ShaftOption.average,
    model: Model = None,
    as_is: AsIs = False,
    allow_outside: AllowOutside = False,
    pdf: Pdf = False,
    as_json: Json = False,
) -> None:
    """Compare recordings with the model: Table II and overlays of measured and simulated force; and
    how each run went, in run.html.

    Of a mechanism or a pendulum: the signals of each recording, with nominal, fitted and held-out
    errors.

    Works offline, changes no recording.

    Example: rfca-rig report runs/SIM-table-ii-001 --out report
    """
    from rfca_rig.campaign.opening import experiment_among

    mechanism = experiment_among(paths)
    if mechanism is None:
        write(
            paths,
            out,
            shaft.value,
            as_json,
            quiet=as_json,
            model=model,
            pdf=pdf,
            as_is=as_is,
            allow_outside=allow_outside,
        )
        return
    # An option without effect must be refused: its user would believe it was applied.
    refuse_leg_options({"--shaft": shaft != ShaftOption.average, "--as-is": as_is})
    _write_mechanism(mechanism, out, as_json, model, pdf, allow_outside)


def refuse_leg_options(given: Mapping[str, bool]) -> None:
    """Raises BadInput for the first given option that only applies to a leg."""
    from rfca_rig.errors import BadInput

    for option, is_given in given.items():
        if is_given:
            raise BadInput(f"{option}: is an option for recordings of a leg; leave it out here")


def _write_mechanism(
    folder: Path, out: Path, as_json: bool, model: Path | None, pdf: bool, allow_outside: bool
) -> None:
    """The same for recordings of a mechanism."""
    from rfca_rig.campaign.opening import open_experiment
    from rfca_rig.cli.options import Printing
    from rfca_rig.cli.progress import progress
    from rfca_rig.diagnosis.mechanisms.fit import compare_mechanism
    from rfca_rig.reports.strokes.motions import mechanism_report

    printing = Printing(pdf)
    experiment = open_experiment(folder, allow_outside, model)
    with progress(as_json) as bars:
        comparison = compare_mechanism(experiment, bars.share)
    page = _write_motions(
        mechanism_report(experiment, comparison), comparison.fit, folder, out, as_json, model
    )
    printing.print([page], as_json)


def _write_motions(
    report: "MotionsReport",
    fit: "WindowFit",
    folder: Path,
    out: Path,
    as_json: bool,
    model: Path | None,
) -> Path:
    """Writes the page of recordings in windows; returns its path."""
    from rfca_rig.reports.provenance import command_line, origin_of_import
    from rfca_rig.reports.strokes.motions import JSON, PAGE, write_motions
    from rfca_rig.reports.text import count_noun

    command = command_line("report", folder, options={"--model": model})
    write_motions(report, fit, out, origin_of_import(command, folder, report.title, report.about))
    if as_json:
        echo(json_text((out / JSON).read_text(encoding="utf-8")), nl=False)
    else:
        recordings = count_noun(len({error.run for error in fit.errors}), "recording")
        echo(f"{out / PAGE}: measured and simulated signals of {recordings}", err=True)
    return out / PAGE


def write(
    paths: Sequence[Path],
    out: Path,
    shaft: "ShaftName",
    as_json: bool,
    quiet: bool,
    model: Path | None = None,
    pdf: bool = False,
    as_is: bool = False,
    allow_outside: bool = False,
) -> None:
    """Writes the report and prints where it is, with the averages of the table.

    Parameters
    ----------
    paths : sequence of Path
        Campaigns, runs or .h5 files.
    out : Path
        Folder of the report.
    shaft : str
        How the simulated shaft turns: average, commanded or recorded.
    as_json : bool
        Print Table II as JSON.
    quiet : bool
        Print nothing else.
    model : Path, optional
        A model file in place of the recordings' nominal model.
    pdf : bool
        Print the pages as PDF too.
    as_is : bool
        Take values of a campaign that are probably in another unit.
    allow_outside : bool
        Follow links of a campaign to files outside its folder.
    """
    from rfca_rig.campaign.opening import open_recordings, open_with_nominal_model
    from rfca_rig.cli.options import Printing
    from rfca_rig.cli.progress import progress
    from rfca_rig.description.model_file import read_model_file
    from rfca_rig.reports.provenance import command_line, origin_of
    from rfca_rig.reports.strokes.page import GivenModel, write_report

    # First: a missing browser must be reported before the work, not after it.
    printing = Printing(pdf)
    if model:
        given = GivenModel(model.name, read_model_file(model).model())
    else:
        given = None
    # Without a model file all recordings must have the same nominal model, which
    # `open_with_nominal_model` checks.
    if given:
        recordings = open_recordings(paths, as_is, allow_outside)
    else:
        recordings = open_with_nominal_model(paths, as_is, allow_outside)
    options: dict[str, object] = {
        "--shaft": shaft if shaft != "average" else None,
        "--model": model,
        "--as-is": as_is,
    }
    command = command_line("report", *paths, options=options)
    with progress(quiet) as bars:
        written = write_report(
            recordings,
            out,
            shaft,
            given,
            origin_of(command, paths, recordings),
            bars.counting("conditions"),
        )
    if as_json:
        echo(json_text((out / "table2.json").read_text(encoding="utf-8")), nl=False)
    if not quiet:
        _say(written.table, out, len(recordings))
    printing.print(written.pages, quiet)


def _say(table: "Table2", out: Path, runs: int) -> None:
    """Prints the pages, the most informative one first."""
    if runs == 1:
        pages = f"{out / 'run.html'}"
    else:
        pages = f"{out / 'run-1.html'} to run-{runs}.html"
    if table.rows:
        if table.average_time_error_pct is None or table.average_force_error_pct is None:
            averages = "no condition with a measured and a simulated valley"
        else:
            averages = (
                f"{len(table.rows)} conditions, average error of the valley "
                f"{table.average_time_error_pct:.1f} % in time, "
                f"{table.average_force_error_pct:.1f} % in force"
            )
        echo(f"{out / 'report.html'}: {averages}", err=True)
    echo(f"{pages}: how the run{'s' if runs > 1 else ''} went", err=True)
