"""rfca-rig import"""

from pathlib import Path
from typing import Annotated

import typer

from rfca_rig.cli.options import Json


def import_folder(
    folder: Annotated[Path, typer.Argument(metavar="FOLDER", help="A folder with campaign.toml, or pendulum.toml, and its CSV files.")],
    out: Annotated[
        Path | None, typer.Option("--out", metavar="DIR", help="New folder for the recording; runs/IMPORT-NAME if not given.")
    ] = None,
    as_is: Annotated[bool, typer.Option("--as-is", help="Import values that are probably in another unit, too.")] = False,
    as_json: Json = False,
) -> None:
    """Read recordings from elsewhere (format rfca-campaign/1) into the form that report and diagnosis work on.

    Recordings of a pendulum (format rfca-pendulum/1) are checked and copied as they stand. A folder with experiment.toml needs no import.

    Example: rfca-rig import my-campaign
    """
    import json

    from rfca_rig.campaign.opening import experiment_among, import_campaign, import_pendulum, pendulum_among
    from rfca_rig.cli.progress import progress
    from rfca_rig.errors import BadInput
    from rfca_rig.recording.store import read_recording

    if experiment_among([folder]) is not None:
        raise BadInput(f"{folder}: holds experiment.toml, which every command reads as it stands; go on with rfca-rig check {folder}")
    target = out or Path("runs") / f"IMPORT-{folder.resolve().name}"
    if pendulum_among([folder]) is not None:
        pendulum = import_pendulum(folder, target)
        if as_json:
            counts = {"links": len(pendulum.pendulum.links), "pendulum_runs": len(pendulum.runs)}
            typer.echo(json.dumps({"source": "IMPORT", "run": str(target), "title": pendulum.title, **counts}, indent=1))
            return
        typer.echo(f"IMPORT {len(pendulum.runs)} runs of a pendulum in {target}; next: rfca-rig diagnose {target}", err=True)
        return
    with progress(as_json) as bars:
        recording = read_recording(import_campaign(folder, target, bars.counting("reading strokes"), as_is))
    if as_json:
        counted = {"strokes": len(recording.strokes), "static_stages": len(recording.static)}
        typer.echo(json.dumps({"source": "IMPORT", "run": str(target), "title": recording.title, **counted}, indent=1))
        return
    counted_text = f"{len(recording.strokes)} strokes and {len(recording.static)} static stages"
    typer.echo(f"IMPORT {counted_text} in {target}; next: rfca-rig report {target} --out report", err=True)
