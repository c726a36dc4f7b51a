"""rfca-rig recover"""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from rfca_rig.cli.options import Json

if TYPE_CHECKING:
    from rfca_rig.progress import ProgressCount
    from rfca_rig.recording.model import Recording


def recover(
    run: Annotated[Path, typer.Argument(metavar="RUN", help="The folder of the run, or the run.h5 that it should have become.")],
    as_json: Json = False,
) -> None:
    """Make a whole recording of a run that a crash or a power cut ended, the stage in progress included. Not while it still goes on.

    Also makes run.h5 again from the files of the stages, where it is missing or damaged.

    Example: rfca-rig recover runs/REAL-flapping-001
    """
    import json

    from rfca_rig.campaign.opening import RECORDING_NAME
    from rfca_rig.cli.progress import progress
    from rfca_rig.recording.checking import is_run_folder
    from rfca_rig.recording.summary import summarize

    path = run if run.suffix == ".h5" else run / RECORDING_NAME
    with progress(as_json) as bars:
        recording = _recover_run(path.parent, bars.counting("stages")) if is_run_folder(path.parent) else _older(path)
    found = summarize(path, thorough=False)
    if as_json:
        counted = {"strokes": found.strokes, "static_stages": found.static, "raw_stages": found.raw}
        typer.echo(json.dumps({"source": recording.source, "run": str(path), "title": recording.title, **counted}, indent=1))
        return
    cut_short = "".join(f", {label} until it was cut short" for label in found.cut_short)
    counted_text = f"{found.strokes} strokes and {found.static} static stages{cut_short}"
    typer.echo(f"{recording.source} recovered {counted_text} in {path}; next: rfca-rig report {path} --out report", err=True)


def _recover_run(folder: Path, watcher: "ProgressCount") -> "Recording":
    """Recovers the run; returns it without its samples."""
    from rfca_rig.bench.stage_photos import read_missing_photos
    from rfca_rig.errors import BadInput
    from rfca_rig.recording import run_folder
    from rfca_rig.recording.checking import can_recover, check_run, describe_damage, needs_no_recovery
    from rfca_rig.recording.run_text import INTERRUPTED, Ending, read_ending, write_ending

    # Once: it reads every file of the run.
    findings = list(check_run(folder))
    if needs_no_recovery(folder, findings):
        raise BadInput(f"{folder}: is whole; there is nothing to recover")
    if not can_recover(folder, findings):
        raise BadInput(describe_damage(folder, findings))
    # First the stage in progress: it belongs into run.h5 like the others.
    run_folder.close_journals(folder)
    # A run that ended normally, and only lost run.h5, keeps what its end says.
    if read_ending(folder) is None:
        found = run_folder.read_without_samples(folder)
        with_photos = read_missing_photos(found, folder)
        # Only the texts that reading the photos added; the end file repeats nothing of the header.
        added = {name: text for name, text in with_photos.provenance.items() if name != "events" and found.provenance.get(name) != text}
        interrupted = {INTERRUPTED: found.provenance[INTERRUPTED]}
        write_ending(folder, Ending({**interrupted, **added}, with_photos.static))
    run_folder.build_recording(folder, watcher)
    return run_folder.read_without_samples(folder)


def _older(path: Path) -> "Recording":
    """Recovers a run of an older version, which left a folder beside the file that it should have become."""
    from rfca_rig.bench.stage_photos import read_missing_photos
    from rfca_rig.errors import BadInput
    from rfca_rig.recording.run_folder import partial_of, recover_partial
    from rfca_rig.recording.store import read_recording, write_recording

    if not partial_of(path).is_dir():
        raise BadInput(_nothing_to_recover(path))
    recording = read_recording(recover_partial(path))
    with_photos = read_missing_photos(recording, path.parent)
    if with_photos is not recording:
        write_recording(with_photos, path)
    return with_photos


def _nothing_to_recover(path: Path) -> str:
    """The reason, for a file or the folder that it should be in, without a run's files beside it."""
    from rfca_rig.errors import BadInput
    from rfca_rig.recording.summary import summarize
    from rfca_rig.suggestions import not_there

    if not path.is_file():
        return (
            f"{path.parent}: holds no interrupted run; rfca-rig runs lists what was recorded"
            if path.parent.is_dir()
            else not_there(path.parent)
        )
    try:
        summarize(path, thorough=False)
    except BadInput as error:
        return f"{error}; and there are no stage files beside it to make it again from"
    return f"{path}: is whole, and there is no interrupted run beside it to recover"
