"""rfca-rig recover, rfca-rig resume: what was recorded of a run that was stopped, and the rest of it"""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from rfca_rig.cli.options import Dry, Json, Operator, Pace, View, ViewPort

if TYPE_CHECKING:
    from rfca_rig.bench.resume import InterruptedRun
    from rfca_rig.cli.run_config import RunConfig
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


def resume(
    run: Annotated[Path, typer.Argument(metavar="RUN", help="The folder of the run.")],
    rig: Annotated[
        str | None,
        typer.Option("--rig", metavar="NAME|FILE", help="Go on with this rig file, though it is not the one that the run began with."),
    ] = None,
    after_trip: Annotated[
        bool, typer.Option("--after-trip", help="Go on although a limit had stopped the motion; look at the rig first.")
    ] = False,
    operator: Operator = "",
    view: View = False,
    view_port: ViewPort = None,
    pace: Pace = 1.0,
    dry_run: Dry = False,
    as_json: Json = False,
) -> None:
    """Go on with a run that was stopped, by ^C, a trip, a crash or a power cut: the stages that are not recorded, into the same folder.

    A real rig is armed again. From wherever the shaft stands it first turns forwards to the start angle.

    Example: rfca-rig resume runs/REAL-table-ii-001
    """
    from dataclasses import replace

    from rfca_rig.bench.resume import read_interrupted_run
    from rfca_rig.cli.attach_view import parse_viewing
    from rfca_rig.cli.commands.dynamic import say_valley
    from rfca_rig.cli.commands.fatigue import Watcher, say_bending
    from rfca_rig.cli.commands.static import say_stage
    from rfca_rig.cli.progress import make_marked_say
    from rfca_rig.cli.run_experiment import run_and_record
    from rfca_rig.errors import BadInput

    begun = read_interrupted_run(run.parent if run.suffix == ".h5" else run)
    config = replace(_order(begun, rig, as_json, dry_run), viewing=parse_viewing(view, view_port, pace), operator=operator)
    if begun.has_tripped and not after_trip:
        # Nothing resumes by itself after a trip: a person must have looked at the rig.
        raise BadInput(f"{begun.folder}: was stopped by {begun.why}; look at the rig, then say --after-trip to go on")
    make_marked_say(config.mark, as_json)(f"{begun.folder} stopped: {begun.why}; what remains of its plan:")
    if config.plan.experiment == "fatigue":
        say_bending(config)
    on_stage = {"dynamic": say_valley, "static": say_stage, "fatigue": Watcher(begun).say_stage}[begun.plan.experiment]
    folder, _ = run_and_record(config, on_stage)
    if folder is not None:
        _close(config, begun, as_json)


def _order(begun: "InterruptedRun", rig: str | None, as_json: bool, dry_run: bool) -> "RunConfig":
    from dataclasses import replace

    from rfca_rig.bench.resume import read_compatible_rig
    from rfca_rig.cli.close_the_loop import nominal_model_of
    from rfca_rig.cli.paths import check_trusted, find_rig
    from rfca_rig.cli.run_config import RunConfig
    from rfca_rig.errors import BadInput
    from rfca_rig.protocol.written_plan import make_remaining_plan

    stored, remaining_plan = begun.header.provenance, make_remaining_plan(begun.plan, begun.done)
    if not remaining_plan.stages:
        raise BadInput(f"{begun.folder}: every stage is recorded; to bring it to its end, type rfca-rig recover {begun.folder}")
    name = rig or stored.get("rig")
    if name is None:
        raise BadInput(f"{begun.folder}: does not say where its rig file is; say so with --rig")
    path = find_rig(name)
    if rig is None:
        # The recording names this file; a recording from elsewhere must not choose what is executed here.
        check_trusted(path, f"--rig {name}")
    now = read_compatible_rig(begun, path, deliberately=rig is not None)
    model, model_text = nominal_model_of(now.rig, begun.header)
    camera_text = stored.get("camera_file", "") if remaining_plan.photos else ""
    return RunConfig(
        rig=now.rig,
        rig_text=now.text,
        protocol_text=stored["protocol_file"],
        # The limits of the present rig file: it may have been changed deliberately.
        plan=replace(remaining_plan, limits=now.rig.facts().limits),
        seed=begun.seed(),
        runs=begun.folder,
        quiet=as_json,
        dry=dry_run,
        model=model,
        model_text=model_text,
        eye=now.rig.eye_behind(camera_text, begun.folder / "camera_file") if camera_text else None,
        camera_text=camera_text,
        rig_name=name,
        begun=begun,
        rig_changes=now.changes,
    )


def _close(config: "RunConfig", begun: "InterruptedRun", as_json: bool) -> None:
    import json

    from rfca_rig.cli.commands import fatigue
    from rfca_rig.cli.finalize_run import describe_contents
    from rfca_rig.recording.layout import RECORDING
    from rfca_rig.recording.summary import summarize

    if begun.plan.experiment == "fatigue":
        fatigue.close(config.mark, begun.folder, as_json)
    elif as_json:
        summary = summarize(begun.folder / RECORDING, thorough=False)
        count = {"strokes": summary.strokes, "static_stages": summary.static, "resumed": begun.resumed + 1}
        typer.echo(json.dumps({"source": config.mark, "run": str(begun.folder), **count}, indent=1))
    else:
        typer.echo(
            f"{config.mark} {describe_contents(begun.folder)} in {begun.folder}; next: rfca-rig report {begun.folder} --out report",
            err=True,
        )
