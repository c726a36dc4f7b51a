"""rfca-rig recover"""

from pathlib import Path
from typing import Annotated

import typer

from rfca_rig.cli.options import Json


def recover(
    run: Annotated[Path, typer.Argument(metavar="RUN", help="The folder of the run, or the run.h5 that it should have become.")],
    as_json: Json = False,
) -> None:
    """Make a whole recording of a run that a crash or a power cut ended. Not while the run is still going on.

    Example: rfca-rig recover runs/REAL-flapping-001
    """
    import json

    from rfca_rig.campaign.opening import RECORDING_NAME
    from rfca_rig.recording import run_file
    from rfca_rig.recording.store import read_recording

    path = run if run.suffix == ".h5" else run / RECORDING_NAME
    recording = read_recording(run_file.recover(path))
    if as_json:
        counted = {"strokes": len(recording.strokes), "static_stages": len(recording.static)}
        typer.echo(json.dumps({"source": recording.source, "run": str(path), "title": recording.title, **counted}, indent=1))
        return
    counted_text = f"{len(recording.strokes)} strokes and {len(recording.static)} static stages"
    typer.echo(f"{recording.source} recovered {counted_text} in {path}; next: rfca-rig report {path} --out report", err=True)
