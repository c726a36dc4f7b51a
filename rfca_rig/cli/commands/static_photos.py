"""rfca-rig static photos"""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from rfca_rig.cli.options import Runs

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from rfca_rig.recording.model import StaticStage


def photos(
    run: Annotated[Path, typer.Argument(metavar="RUN", help="The recording whose stages they are of: a run, or a campaign's folder.")],
    folder: Annotated[Path, typer.Argument(metavar="PHOTOS", help="A folder with one photo for each stage, named in their order.")],
    camera: Annotated[
        Path, typer.Option("--camera", metavar="FILE", help="The camera they were taken with, as calibrate camera wrote it.")
    ] = Path("calibration/camera.toml"),
    mark_diameter: Annotated[
        float | None,
        typer.Option("--mark-diameter", metavar="MM", min=1, max=100, help="Diameter of the red marks, where the run does not say."),
    ] = None,
    runs: Runs = Path("runs"),
) -> None:
    """Read hinge angles off photos taken by hand, or again with a better calibration; the recording with them goes into a new folder.

    Example: rfca-rig static photos runs/REAL-static-001 card/ --camera lab.toml
    """
    from dataclasses import replace
    from shutil import rmtree

    from rfca_rig.bench.stage_photos import eye_for, with_hand_photos
    from rfca_rig.campaign.opening import RECORDING_NAME, open_recordings
    from rfca_rig.cli.paths import make_run_folder
    from rfca_rig.cli.progress import progress
    from rfca_rig.description.toml import read_text
    from rfca_rig.drivers.photo_files import list_photos
    from rfca_rig.recording.store import write_recording

    (recording,) = open_recordings([run])
    files, eye = list_photos(folder), eye_for(recording, camera, mark_diameter)
    target = make_run_folder(runs, recording.source, recording.title)
    try:
        with progress(quiet=False) as bars:
            with_angles = with_hand_photos(recording, files, eye, target, bars.counting("reading photos"))
        sources = {"camera_file": read_text(camera), "photos_from": folder.resolve().name}
        write_recording(replace(with_angles, provenance={**with_angles.provenance, **sources}), target / RECORDING_NAME)
    # A folder with photos but without a recording is of no use to any command.
    except BaseException:
        rmtree(target, ignore_errors=True)
        raise
    for line in photo_lines(with_angles.static):
        typer.echo(f"{recording.source} {line}", err=True)
    typer.echo(
        f"{recording.source} {len(with_angles.static)} stages with their photos in {target}; next: rfca-rig static report {target}",
        err=True,
    )


def photo_lines(stages: "Sequence[StaticStage]") -> "Iterator[str]":
    """A line for each photo: its hinge angles and doubts."""
    for stage in stages:
        if stage.photo:
            angles = " ".join(_with_std(*one) for one in zip(stage.hinge_deg, stage.hinge_std_deg, strict=True))
            doubts = f"; {stage.photo_doubts}" if stage.photo_doubts else ""
            yield f"{stage.photo}, stage {stage.stage} at {1e3 * stage.height_m:g} mm: hinges {angles} deg{doubts}"


def _with_std(angle_deg: float, std_deg: float) -> str:
    from math import isnan

    return "?" if isnan(angle_deg) else f"{angle_deg:.2f}+-{std_deg:.2f}"
