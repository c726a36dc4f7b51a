"""rfca-rig fatigue"""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from rfca_rig.cli.options import (
    Command,
    Dry,
    Json,
    Model,
    Operator,
    Pace,
    Protocol,
    Rig,
    Runs,
    Sample,
    Seed,
    View,
    ViewPort,
)
from rfca_rig.cli.terminal import echo

if TYPE_CHECKING:
    from rfca_rig.analysis.static_forces import StiffnessDrift
    from rfca_rig.bench.recorder import Recorder
    from rfca_rig.bench.resume import InterruptedRun
    from rfca_rig.cli.run_config import RunConfig
    from rfca_rig.cli.terminal import Say
    from rfca_rig.description.protocol_file import FatigueFile
    from rfca_rig.protocol.plan import Stage, StiffnessCheck
    from rfca_rig.recording.model import StaticStage

app = typer.Typer(
    help="Fatigue: bend the leg again and again, and look now and then how stiff it still is.",
    no_args_is_help=True,
)


@app.callback()
def _group() -> None:
    """Keeps `run` a command of its own."""


@app.command(cls=Command)
def run(
    protocol: Protocol = "fatigue",
    cycles: Annotated[
        int | None,
        typer.Option(
            "--cycles", min=1, metavar="N", help="Cycles, in place of the protocol's number."
        ),
    ] = None,
    rig: Rig = "twin",
    model: Model = None,
    runs: Runs = Path("runs"),
    seed: Seed = None,
    operator: Operator = "",
    sample: Sample = "",
    view: View = False,
    view_port: ViewPort = None,
    pace: Pace = 1.0,
    dry_run: Dry = False,
    as_json: Json = False,
) -> None:
    """Turn the shaft on and on, count every cycle on disk, check the stiffness now and then, and
    stop where it drifts too far.

    A run that was stopped goes on with rfca-rig resume RUN.

    Example: rfca-rig fatigue run --cycles 1000
    """
    from rfca_rig.cli.attach_view import parse_viewing
    from rfca_rig.cli.run_config import RunOptions, make_run_config
    from rfca_rig.cli.run_experiment import run_and_record
    from rfca_rig.description.protocol_file import read_fatigue
    from rfca_rig.protocol.experiments import fatigue_plan

    viewing = parse_viewing(view, view_port, pace)
    asked = RunOptions(
        rig,
        protocol,
        model,
        runs,
        seed,
        operator,
        sample,
        is_dry=dry_run,
        is_quiet=as_json,
        viewing=viewing,
    )
    config = make_run_config(
        asked,
        lambda path, facts: fatigue_plan(_as_asked(read_fatigue(path), cycles).fatigue(), facts),
    )
    say_bending(config)
    folder, _ = run_and_record(config, Watcher().say_stage)
    if folder is not None:
        close(config.mark, folder, as_json)


def _as_asked(protocol: "FatigueFile", cycles: int | None) -> "FatigueFile":
    """The protocol with the values that the command line replaces."""
    from rfca_rig.toml import validate

    if cycles is None:
        return protocol
    return validate({**protocol.model_dump(), "cycles": cycles}, type(protocol), "--cycles")


def say_bending(config: "RunConfig") -> None:
    """Prints how far the model bends the leg in a cycle, before anything moves."""
    from rfca_rig.bench.expectation import predict_bending
    from rfca_rig.cli.progress import make_marked_say
    from rfca_rig.protocol.plan import cycles_in

    for height_m, speed_rad_s in sorted(
        {(stage.height_m, stage.speed_rad_s) for stage in cycles_in(config.plan)}
    ):
        bending = predict_bending(config.nominal_source.model(), height_m, speed_rad_s)
        make_marked_say(config.mark, config.quiet)(
            f"a cycle at {1e3 * height_m:.1f} mm bends the leg by {bending.text()}, says the model"
        )


@dataclass(frozen=True)
class Watcher:
    """Prints what each stage gave, and ends the run where the leg is worn. `begun` is set for a
    continued run.
    """

    begun: "InterruptedRun | None" = None

    def say_stage(self, stage: "Stage", recorder: "Recorder", say: "Say") -> None:
        from rfca_rig.cli.commands.measure.dynamic import say_valley
        from rfca_rig.protocol.plan import Cycles, Flap, StiffnessCheck

        match stage:
            case Flap():
                say_valley(stage, recorder, say)
            case Cycles():
                say(f"{recorder.cycles_done} cycles done")
            case StiffnessCheck():
                self._judge(stage, recorder, say)

    def _judge(self, stage: "StiffnessCheck", recorder: "Recorder", say: "Say") -> None:
        from rfca_rig.errors import WornOut

        earlier: Sequence[StaticStage] = ()
        # The first check, with which all are compared, may lie in an earlier part of the run.
        if self.begun is not None:
            earlier = self.begun.static
        drift = _drift(stage, (*earlier, *recorder.stages))
        if drift is None or stage.number == 1:
            return
        message = f"{stage.label}: the forces are {drift.text()} off those of the first"
        if not abs(drift.relative) <= stage.drift_limit:
            # An error of its own, with exit code 4: a worn leg is the result of the test, not a
            # failure of it.
            raise WornOut(
                f"{message}, limit {100.0 * stage.drift_limit:g} %; look at the leg "
                "before anything else"
            )
        say(message)


def _drift(stage: "StiffnessCheck", stages: "Sequence[StaticStage]") -> "StiffnessDrift | None":
    from rfca_rig.analysis.static_forces import stiffness_drift

    return stiffness_drift(stages, stage.holds, stage.number)


def close(mark: str, folder: Path, as_json: bool) -> None:
    """Prints the last lines: cycles done, drift of the stiffness, and what to type next."""
    import json

    summary = _results(folder)
    if as_json:
        echo(json.dumps({"source": mark, "run": str(folder), **summary}, indent=1))
        return
    drift = ""
    if summary["checks"]:
        last = summary["checks"][-1]
        drift = (
            f", stiffness drift {last['drift_percent']:+.2f} +- {last['std_percent']:.2f} % "
            "since the first check"
        )
    echo(
        (
            f"{mark} {summary['cycles']} of {summary['planned']} cycles done in {folder}{drift}; "
            f"next: rfca-rig check {folder}"
        ),
        err=True,
    )


def _results(folder: Path) -> dict[str, Any]:
    """Cycles counted and planned, strokes among them, and the drift at each check after the
    first.
    """
    from rfca_rig.protocol.plan import StiffnessCheck, cycles_in
    from rfca_rig.protocol.written_plan import parse_plan
    from rfca_rig.recording.run_folder import read_stages
    from rfca_rig.recording.tables import cycle_table

    recording = read_stages(folder)
    plan = parse_plan(recording.title, recording.provenance)
    checks = [
        stage for stage in plan.stages if isinstance(stage, StiffnessCheck) and stage.number > 1
    ]
    drifts = [
        (stage.number, drift)
        for stage in checks
        if (drift := _drift(stage, recording.static)) is not None
    ]
    return {
        "cycles": len(cycle_table(recording).numbers) + len(recording.strokes),
        "planned": sum(stage.count for stage in cycles_in(plan)) + len(plan.flaps),
        "checks": [
            {
                "check": number,
                "drift_percent": 100.0 * drift.relative,
                "std_percent": 100.0 * drift.std,
            }
            for number, drift in drifts
        ],
    }
