"""rfca-rig report"""

from collections.abc import Sequence
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from rfca_rig.cli.options import Json, Model

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
    out: Annotated[Path, typer.Option("--out", metavar="DIR", help="Folder for report.html and table2.csv, .tex, .json.")] = Path("report"),
    shaft: Annotated[
        Shaft, typer.Option("--shaft", help="Simulate at the average measured speed (as the paper does), as commanded, or as recorded.")
    ] = Shaft.average,
    model: Model = None,
    as_json: Json = False,
) -> None:
    """Compare recordings with the model: Table II and overlays of measured and simulated force. Works offline, changes no recording.

    Example: rfca-rig report runs/SIM-table-ii-001 --out report
    """
    write(paths, out, shaft.value, as_json, quiet=as_json, model=model)


def write(paths: Sequence[Path], out: Path, shaft: "ShaftName", as_json: bool, quiet: bool, model: Path | None = None) -> None:
    """Writes the report and says where it is, with the averages of the table."""
    from rfca_rig.campaign.opening import open_recordings, open_with_belief
    from rfca_rig.description.model_file import read_model_file
    from rfca_rig.report.sources import GivenModel
    from rfca_rig.report.writing import write_report

    given = GivenModel(model.name, read_model_file(model).model()) if model else None
    recordings = open_recordings(paths) if given else open_with_belief(paths)
    table = write_report(recordings, out, shaft, given)
    if as_json:
        typer.echo((out / "table2.json").read_text(encoding="utf-8"), nl=False)
    if not quiet:
        typer.echo(f"{out / 'report.html'}: {_averages(table)}", err=True)


def _averages(table: "Table2") -> str:
    if table.average_time_error_pct is None or table.average_force_error_pct is None:
        return "no condition with a measured and a simulated valley"
    return (
        f"{len(table.rows)} conditions, average error of the valley {table.average_time_error_pct:.1f} % in time, "
        f"{table.average_force_error_pct:.1f} % in force"
    )
