"""rfca-rig resume"""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from rfca_rig.cli.options import Dry, Json, Operator, Pace, View, ViewPort
from rfca_rig.cli.terminal import echo

if TYPE_CHECKING:
    from rfca_rig.bench.resume import InterruptedRun
    from rfca_rig.bench.rig_compatibility import Noted
    from rfca_rig.cli.run_config import RunConfig


def resume(
    run: Annotated[Path, typer.Argument(metavar="RUN", help="The folder of the run.")],
    rig: Annotated[
        str | None,
        typer.Option(
            "--rig",
            metavar="NAME|FILE",
            help="Go on with this rig file, though it is not the one that the run began with.",
        ),
    ] = None,
    after_trip: Annotated[
        bool,
        typer.Option(
            "--after-trip",
            help="Go on although a limit had stopped the motion; look at the rig first.",
        ),
    ] = False,
    operator: Operator = "",
    view: View = False,
    view_port: ViewPort = None,
    pace: Pace = 1.0,
    dry_run: Dry = False,
    as_json: Json = False,
) -> None:
    """Go on with a run that was stopped, by ^C, a trip, a crash or a power cut: the stages that are
    not recorded, into the same folder.

    A real rig is armed again. From wherever the shaft stands it first turns forwards to the start
    angle.

    Example: rfca-rig resume runs/REAL-table-ii-001
    """
    from dataclasses import replace

    from rfca_rig.bench.resume import read_interrupted_run
    from rfca_rig.cli.attach_view import parse_viewing
    from rfca_rig.cli.commands.measure.dynamic import say_valley
    from rfca_rig.cli.commands.measure.fatigue import Watcher, say_bending
    from rfca_rig.cli.commands.measure.static import say_stage
    from rfca_rig.cli.progress import make_marked_say
    from rfca_rig.cli.run_experiment import run_and_record
    from rfca_rig.errors import BadInput

    if run.suffix == ".h5":
        run = run.parent
    begun = read_interrupted_run(run)
    config = replace(
        _order(begun, rig, as_json, dry_run),
        viewing=parse_viewing(view, view_port, pace),
        operator=operator,
    )
    if begun.has_tripped and not after_trip:
        # Nothing resumes by itself after a trip: a person must have looked at the rig.
        raise BadInput(
            f"{begun.folder}: was stopped by {begun.why}; look at the rig, then say "
            "--after-trip to go on"
        )
    make_marked_say(config.mark, as_json)(
        f"{begun.folder} stopped: {begun.why}; what remains of its plan:"
    )
    if config.plan.experiment == "fatigue":
        say_bending(config)
    on_stage = {"dynamic": say_valley, "static": say_stage, "fatigue": Watcher(begun).say_stage}[
        begun.plan.experiment
    ]
    folder, _ = run_and_record(config, on_stage)
    if folder is not None:
        _close(config, begun, as_json)


def _order(begun: "InterruptedRun", rig: str | None, as_json: bool, dry_run: bool) -> "RunConfig":
    from dataclasses import replace

    from rfca_rig.bench.rig_compatibility import check_camera_file, read_compatible_rig
    from rfca_rig.cli.close_the_loop import nominal_model_of
    from rfca_rig.cli.paths import check_trusted, find_rig
    from rfca_rig.cli.run_config import RunConfig
    from rfca_rig.errors import BadInput
    from rfca_rig.protocol.written_plan import make_remaining_plan

    stored = begun.header.provenance
    remaining_plan = make_remaining_plan(begun.plan, begun.done)
    if not remaining_plan.stages:
        raise BadInput(
            f"{begun.folder}: every stage is recorded; to bring it to its end, type "
            f"rfca-rig recover {begun.folder}"
        )
    name = rig or stored.get("rig")
    if name is None:
        raise BadInput(f"{begun.folder}: does not say where its rig file is; say so with --rig")
    path = find_rig(name)
    if rig is None:
        # The recording names this file; a recording from elsewhere must not choose what is executed
        # here.
        check_trusted(path, f"--rig {name}")
    now = read_compatible_rig(begun, path, deliberately=rig is not None)
    model, model_text = nominal_model_of(now.rig, begun.header)
    eye = None
    camera_text = ""
    if remaining_plan.photos:
        camera_text = stored.get("camera_file", "")
    noted: Noted = {}
    if camera_text:
        noted = check_camera_file(begun, now.rig)
        eye = now.rig.eye_behind(camera_text, begun.folder / "camera_file")
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
        eye=eye,
        camera_text=camera_text,
        rig_name=name,
        rig_path=path,
        begun=begun,
        rig_changes=now.changes,
        noted_changes=noted,
        accepts_changes=rig is not None,
    )


def _close(config: "RunConfig", begun: "InterruptedRun", as_json: bool) -> None:
    import json

    from rfca_rig.cli.commands.measure import fatigue
    from rfca_rig.cli.finalize_run import describe_contents
    from rfca_rig.recording.layout import RECORDING
    from rfca_rig.recording.store import summarize

    if begun.plan.experiment == "fatigue":
        fatigue.close(config.mark, begun.folder, as_json)
    elif as_json:
        summary = summarize(begun.folder / RECORDING, thorough=False)
        count = {
            "strokes": summary.strokes,
            "static_stages": summary.static,
            "resumed": begun.resumed + 1,
        }
        echo(json.dumps({"source": config.mark, "run": str(begun.folder), **count}, indent=1))
    else:
        echo(
            (
                f"{config.mark} {describe_contents(begun.folder)} in {begun.folder}; next: "
                f"rfca-rig report {begun.folder} --out report"
            ),
            err=True,
        )
