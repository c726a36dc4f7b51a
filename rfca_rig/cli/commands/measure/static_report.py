"""rfca-rig static report"""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from rfca_rig.cli.options import AsIs, Json, Model, Pdf, out_folder

if TYPE_CHECKING:
    from rfca_rig.analysis.torque_rotation.static_result import StaticResult
    from rfca_rig.recording.model import Recording

HINGE_STD = typer.Option(
    "--hinge-std-deg", metavar="DEG", min=1e-4, max=10, help="One standard deviation of a hinge angle, where the stages do not say."
)
MARKS = typer.Option(
    "--marks-deg", metavar="DEG", min=0, max=5, help="How far a hinge's zero may be off because a mark sits beside its axis."
)
# Defaults of options, which the command in the report's footer leaves out.
USUAL = {"--marks-deg": 0.1, "--force-gain-pct": 0.0}
GAIN = typer.Option(
    "--force-gain-pct", metavar="PERCENT", min=0, max=20, help="One standard deviation of the force sensor's gain; 0 counts as exact."
)


def report(
    paths: Annotated[list[Path], typer.Argument(metavar="PATH", help="Campaign folders, imported or run folders, or .h5 files.")],
    out: Annotated[
        Path, typer.Option("--out", metavar="DIR", callback=out_folder, help="Folder for static.html, the tables and model.toml.")
    ] = Path("static-report"),
    model: Model = None,
    hinge_std_deg: Annotated[float | None, HINGE_STD] = None,
    marks_deg: Annotated[float, MARKS] = USUAL["--marks-deg"],
    force_gain_pct: Annotated[float, GAIN] = USUAL["--force-gain-pct"],
    as_is: AsIs = False,
    pdf: Pdf = False,
    as_json: Json = False,
) -> None:
    """The hinges' torque over rotation from photographed static stages: curve, stiffness, errors, checks, and a model file with them.

    Example: rfca-rig static report runs/REAL-static-001 --out static-report
    """
    import json

    from rfca_rig.analysis.torque_rotation.evaluate import StageAssumptions, evaluate
    from rfca_rig.analysis.torque_rotation.stages import Instruments
    from rfca_rig.campaign.opening import open_recordings
    from rfca_rig.cli.options import Printing
    from rfca_rig.cli.progress import progress
    from rfca_rig.reports.provenance import command_line, origin_of
    from rfca_rig.reports.static.files import summary, write_static_report
    from rfca_rig.reports.static.tables import static_sources

    printing = Printing(pdf)
    recordings = open_recordings(paths, as_is)
    instrument = {"--hinge-std-deg": hinge_std_deg, "--marks-deg": marks_deg, "--force-gain-pct": force_gain_pct}
    options: dict[str, object] = {"--model": model, **instrument, "--as-is": as_is}
    command = command_line("static", "report", *paths, options={name: value for name, value in options.items() if value != USUAL.get(name)})
    nominal, known_to = read_nominal_values(recordings, model)
    instruments = Instruments(0.01 * force_gain_pct, marks_deg)
    with progress(as_json) as bars:
        result = evaluate(recordings, StageAssumptions(nominal, known_to, instruments, hinge_std_deg), bars.counting("solving"))
    write_static_report(
        result,
        static_sources(paths, recordings),
        out,
        nominal,
        known_to,
        model.name if model else None,
        origin_of(command, paths, recordings),
    )
    if as_json:
        typer.echo(json.dumps(summary(result), indent=1))
    else:
        _say(result, out)
    printing.print([out / "static.html"], as_json)


def read_nominal_values(recordings: "Sequence[Recording]", model: Path | None) -> tuple[Mapping[str, Any], Mapping[str, Any]]:
    """Nominal model and known_to of the recordings, or of the model file. Raises BadInput where the recordings differ."""
    from rfca_rig.description.model_file import read_model_file
    from rfca_rig.errors import BadInput

    if model is not None:
        given = read_model_file(model)
        return given.nominal(), given.known_to.model_dump(exclude_none=True)
    first = recordings[0]
    for other in recordings[1:]:
        # One evaluation has one nominal model.
        if other.nominal != first.nominal or other.known_to != first.known_to:
            raise BadInput(f"{other.title!r} believes other values of the rig than {first.title!r}; give one model for both with --model")
    if not first.nominal:
        raise BadInput(f"{first.title!r} does not say what leg it is of; give a model with --model")
    return first.nominal, first.known_to


def _say(result: "StaticResult", out: Path) -> None:
    from rfca_rig.analysis.torque_rotation.static_result import remarks
    from rfca_rig.reports.static.page import bend_sentence

    values = result.values
    for line in remarks(result):
        typer.echo(line, err=True)
    typer.echo(bend_sentence(result), err=True)
    typer.echo(
        f"{out / 'static.html'}: k0 {values.k0_Nm_per_rad:.3f} +- {values.reach * values.k0_std:.3f} N m/rad, "
        f"k2 {values.k2_per_rad2:.3f} +- {values.reach * values.k2_std:.3f} 1/rad2 (95 %)",
        err=True,
    )
