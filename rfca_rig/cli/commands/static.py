"""rfca-rig static"""

from math import isnan
from pathlib import Path
from typing import TYPE_CHECKING

import typer

from rfca_rig.cli.commands import static_loads, static_photos, static_report
from rfca_rig.cli.help import Command
from rfca_rig.cli.options import Dry, Fault, Json, Model, Operator, Pace, Protocol, Rig, Runs, Sample, Seed, View, ViewPort

if TYPE_CHECKING:
    from rfca_rig.bench.recorder import Recorder
    from rfca_rig.cli.terminal import Say
    from rfca_rig.protocol.plan import Stage
    from rfca_rig.recording.model import StaticStage

app = typer.Typer(help="The static experiment: turn the shaft in stages, let the leg settle, measure.", no_args_is_help=True)


app.command("report", cls=Command)(static_report.report)
app.command("photos", cls=Command)(static_photos.photos)
app.command("load", cls=Command)(static_loads.load)
app.command("force", cls=Command)(static_loads.force)


@app.command(cls=Command)
def run(
    protocol: Protocol = "static-angle",
    rig: Rig = "twin",
    model: Model = None,
    runs: Runs = Path("runs"),
    seed: Seed = None,
    operator: Operator = "",
    sample: Sample = "",
    view: View = False,
    view_port: ViewPort = None,
    pace: Pace = 1.0,
    fault: Fault = None,
    dry_run: Dry = False,
    as_json: Json = False,
) -> None:
    """Go through the stages of a protocol at each of its heights; record force, shaft and hinge angles once they have settled.

    Example: rfca-rig static run --protocol bending
    """
    from rfca_rig.cli.attach_view import parse_viewing
    from rfca_rig.cli.run_experiment import run_and_record
    from rfca_rig.cli.run_options import RunOptions, make_run_config
    from rfca_rig.description.protocol_file import read_static
    from rfca_rig.protocol.experiments import static_plan

    viewing = parse_viewing(view, view_port, pace)
    asked = RunOptions(
        rig, protocol, model, runs, seed, operator, sample, is_dry=dry_run, is_quiet=as_json, viewing=viewing, faults=fault or ()
    )
    config = make_run_config(asked, lambda path, facts: static_plan(read_static(path).static_stages(), facts))
    folder, recorder = run_and_record(config, say_stage)
    if folder is None or recorder is None:
        return
    if as_json:
        _print_json(config.mark, folder, recorder.stages)
    else:
        for line in static_photos.photo_lines(recorder.stages):
            typer.echo(f"{config.mark} {line}", err=True)
        following = f"static report {folder}" if any(stage.overlay for stage in recorder.stages) else f"report {folder} --out report"
        typer.echo(f"{config.mark} recorded {len(recorder.stages)} stages in {folder}; next: rfca-rig {following}", err=True)


def say_stage(stage: "Stage", recorder: "Recorder", say: "Say") -> None:
    """Prints a line for every static stage."""
    from rfca_rig.protocol.plan import Hold

    if isinstance(stage, Hold):
        row = recorder.stages[-1]
        unsettled = "" if row.settled else f", NOT SETTLED within {stage.settle.limit_s:g} s"
        no_photo = f", NO PHOTO: {row.photo_doubts}" if row.photo_doubts else ""
        say(f"{stage.label}: fy {row.fy_N:.2f} N, fz {row.fz_N:.2f} N, tx {row.tx_Nm:.3f} N m{unsettled}{no_photo}")


def _print_json(mark: str, folder: Path, stages: "list[StaticStage]") -> None:
    import json

    rows = [
        {
            "height_mm": round(1e3 * stage.height_m, 6),
            "stage": stage.stage,
            "direction": stage.direction,
            "shaft_angle_rad": stage.shaft_angle_rad,
            "fy_N": stage.fy_N,
            "fz_N": stage.fz_N,
            "tx_Nm": stage.tx_Nm,
            "settled": stage.settled,
            # JSON has no NaN; null stands for an unknown angle.
            "hinge_deg": [None if isnan(angle) else angle for angle in stage.hinge_deg],
            "hinge_std_deg": [None if isnan(std) else std for std in stage.hinge_std_deg],
            "photo": stage.photo,
            "overlay": stage.overlay,
            "photo_doubts": stage.photo_doubts,
        }
        for stage in stages
    ]
    typer.echo(json.dumps({"source": mark, "run": str(folder), "stages": rows}, indent=1))
