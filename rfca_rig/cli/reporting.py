"""rfca-rig report"""

from collections.abc import Mapping, Sequence
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from rfca_rig.cli.options import Json, Model, Pdf
from rfca_rig.cli.writable import out_folder

if TYPE_CHECKING:
    from rfca_rig.analysis.counterpart import Shaft as ShaftName
    from rfca_rig.analysis.table2 import Table2


class Shaft(StrEnum):
    """How the simulated shaft turns."""

    average = "average"
    commanded = "commanded"
    recorded = "recorded"


def report(
    paths: Annotated[list[Path], typer.Argument(metavar="PATH...", help="Campaign folders, imported or run folders, or .h5 files.")],
    out: Annotated[
        Path, typer.Option("--out", metavar="DIR", callback=out_folder, help="Folder for report.html, run.html, their tables.")
    ] = Path("report"),
    shaft: Annotated[
        Shaft, typer.Option("--shaft", help="Simulate at the average measured speed (as the paper does), as commanded, or as recorded.")
    ] = Shaft.average,
    model: Model = None,
    pdf: Pdf = False,
    as_json: Json = False,
) -> None:
    """Compare recordings with the model: Table II and overlays of measured and simulated force; and tell how each run went, in run.html.

    Of a pendulum: angles and speeds of each run, with nominal, fitted and held-out errors.

    Works offline, changes no recording.

    Example: rfca-rig report runs/SIM-table-ii-001 --out report
    """
    from rfca_rig.campaign.opening import pendulum_among

    pendulum = pendulum_among(paths)
    if pendulum is None:
        write(paths, out, shaft.value, as_json, quiet=as_json, model=model, pdf=pdf)
        return
    refuse_leg_options({"--shaft": shaft != Shaft.average})
    _write_pendulum(pendulum, out, as_json, model, pdf)


def refuse_leg_options(given: Mapping[str, bool]) -> None:
    """Raises BadInput for the first option that was given and is for a leg alone."""
    from rfca_rig.errors import BadInput

    for option, is_given in given.items():
        if is_given:
            raise BadInput(f"{option}: is an option for recordings of a leg; leave it out here")


def _write_pendulum(folder: Path, out: Path, as_json: bool, model: Path | None, pdf: bool) -> None:
    """The same of a pendulum's recordings."""
    from rfca_rig.campaign.pendulum import read_pendulum_campaign
    from rfca_rig.campaign.pendulum_model import with_model_file
    from rfca_rig.cli.printing import Printing
    from rfca_rig.cli.progress import progress
    from rfca_rig.diagnosis.pendulums.fit import fit_pendulum
    from rfca_rig.report.origin import imported, typed
    from rfca_rig.report.pendulum_page import JSON_FILE, PAGE, write_pendulum_report

    printing = Printing(pdf)
    campaign = read_pendulum_campaign(folder)
    if model is not None:
        campaign = with_model_file(campaign, model)
    with progress(as_json) as bars:
        found = fit_pendulum(campaign, bars.share)
    command = typed("report", folder, options={"--model": model})
    write_pendulum_report(campaign, found, out, imported(command, folder, campaign.title), model.name if model else None)
    if as_json:
        typer.echo((out / JSON_FILE).read_text(encoding="utf-8"), nl=False)
    else:
        typer.echo(f"{out / PAGE}: measured and simulated angles of {len(campaign.runs)} runs", err=True)
    printing.print([out / PAGE], as_json)


def write(
    paths: Sequence[Path],
    out: Path,
    shaft: "ShaftName",
    as_json: bool,
    quiet: bool,
    model: Path | None = None,
    pdf: bool = False,
) -> None:
    """Writes the report and says where it is, with the averages of the table."""
    from rfca_rig.campaign.opening import open_recordings, open_with_belief
    from rfca_rig.cli.printing import Printing
    from rfca_rig.cli.progress import progress
    from rfca_rig.description.model_file import read_model_file
    from rfca_rig.report.origin import origin_of, typed
    from rfca_rig.report.sources import GivenModel
    from rfca_rig.report.writing import write_report

    printing = Printing(pdf)
    given = GivenModel(model.name, read_model_file(model).model()) if model else None
    recordings = open_recordings(paths) if given else open_with_belief(paths)
    command = typed("report", *paths, options={"--shaft": shaft if shaft != "average" else None, "--model": model})
    with progress(quiet) as bars:
        written = write_report(recordings, out, shaft, given, origin_of(command, paths, recordings), bars.counting("conditions"))
    if as_json:
        typer.echo((out / "table2.json").read_text(encoding="utf-8"), nl=False)
    if not quiet:
        _say(written.table, out, len(recordings))
    printing.print(written.pages, quiet)


def _say(table: "Table2", out: Path, runs: int) -> None:
    """The page that tells most comes first."""
    pages = f"{out / 'run.html'}" if runs == 1 else f"{out / 'run-1.html'} to run-{runs}.html"
    if table.rows:
        typer.echo(f"{out / 'report.html'}: {_averages(table)}", err=True)
    typer.echo(f"{pages}: how the run{'s' if runs > 1 else ''} went", err=True)


def _averages(table: "Table2") -> str:
    if table.average_time_error_pct is None or table.average_force_error_pct is None:
        return "no condition with a measured and a simulated valley"
    return (
        f"{len(table.rows)} conditions, average error of the valley {table.average_time_error_pct:.1f} % in time, "
        f"{table.average_force_error_pct:.1f} % in force"
    )
