"""rfca-rig dynamic run"""

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from rfca_rig.cli.options import (
    Command,
    Dry,
    Fault,
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
    out_folder,
)
from rfca_rig.cli.since_reference import (
    Gate,
    SinceReference,
    compare_with_set_reference,
    pass_gate,
)
from rfca_rig.cli.terminal import echo

if TYPE_CHECKING:
    from rfca_rig.analysis.phases import Undetermined, Valley
    from rfca_rig.bench.recorder import Recorder
    from rfca_rig.cli.terminal import Say
    from rfca_rig.description.protocol_file import DynamicFile
    from rfca_rig.protocol.plan import Stage

app = typer.Typer(
    help="The dynamic experiment: flap against the ground, record force and shaft over time.",
    no_args_is_help=True,
)


@app.callback()
def _group() -> None:
    """Keeps `run` a command of its own."""


@app.command(cls=Command)
def run(
    height: Annotated[
        float | None,
        typer.Option("--height", metavar="MM", help="Height of the shaft above the ground."),
    ] = None,
    speed: Annotated[
        float | None, typer.Option("--speed", metavar="RAD/S", help="Speed of the shaft.")
    ] = None,
    repeats: Annotated[
        int | None, typer.Option("--repeats", metavar="N", min=1, help="Strokes per condition.")
    ] = None,
    protocol: Protocol = "flapping",
    rig: Rig = "twin",
    model: Model = None,
    report: Annotated[
        Path | None,
        typer.Option(
            "--report",
            metavar="DIR",
            callback=out_folder,
            help="Write the report of this run there as well.",
        ),
    ] = None,
    runs: Runs = Path("runs"),
    seed: Seed = None,
    operator: Operator = "",
    sample: Sample = "",
    view: View = False,
    view_port: ViewPort = None,
    pace: Pace = 1.0,
    fault: Fault = None,
    gate: Gate = False,
    dry_run: Dry = False,
    as_json: Json = False,
) -> None:
    """Flap at one condition (--height and --speed) or at those of a protocol, and record every
    stroke. Where the rig has a reference (reference set), say what has changed since then.

    Example: rfca-rig dynamic run --height 215 --speed 2.433 --repeats 5
    """
    from rfca_rig.cli.attach_view import parse_viewing
    from rfca_rig.cli.run_config import RunOptions, make_run_config
    from rfca_rig.cli.run_experiment import run_and_record
    from rfca_rig.description.protocol_file import read_dynamic
    from rfca_rig.protocol.experiments import flapping_plan

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
        faults=fault or (),
    )
    config = make_run_config(
        asked,
        lambda path, facts: flapping_plan(
            replace_conditions(read_dynamic(path), height, speed, repeats).flapping(), facts
        ),
    )
    valleys = Valleys()
    folder, _ = run_and_record(config, valleys.say_stage)
    if folder is not None:
        answer = compare_with_set_reference(folder, gate, as_json)
        _close(FinishedStrokes(config.mark, folder, valleys.rows, answer), report, as_json)
        pass_gate(answer, gate)


def replace_conditions(
    protocol: "DynamicFile", height_mm: float | None, speed_rad_s: float | None, repeats: int | None
) -> "DynamicFile":
    """The protocol with these values in place of its conditions and repeats. Raises BadInput
    where the file's format forbids them.
    """
    from rfca_rig.description.protocol_file import ConditionSection, DynamicFile
    from rfca_rig.errors import BadInput
    from rfca_rig.toml import validate

    if (height_mm is None) != (speed_rad_s is None):
        raise BadInput("give --height and --speed together; alone, each leaves the other to chance")
    changes: dict[str, Any] = {}
    if repeats is not None:
        changes["repeats"] = repeats
    if height_mm is not None and speed_rad_s is not None:
        condition = validate(
            {"height_mm": height_mm, "speed_rad_s": speed_rad_s},
            ConditionSection,
            "--height, --speed",
        )
        changes |= {
            "conditions": (condition,),
            "title": f"{protocol.title} {height_mm:g} mm {speed_rad_s:g} rad per s",
        }
    # Checked again as a whole: a copy alone would take values that the file's format forbids.
    return validate(protocol.model_copy(update=changes).model_dump(), DynamicFile, "--repeats")


def say_valley(stage: "Stage", recorder: "Recorder", say: "Say") -> None:
    """A line for every stroke."""
    from rfca_rig.analysis.phases import stroke_valley
    from rfca_rig.protocol.plan import Flap

    if isinstance(stage, Flap):
        say(f"{stage.label}: {valley_text(stroke_valley(recorder.strokes[-1]))}")


class Valleys:
    """Prints a line for every stroke and keeps a row of numbers for the end; the strokes
    themselves stay on disk.
    """

    def __init__(self) -> None:
        self.rows: list[dict[str, float | None]] = []

    def say_stage(self, stage: "Stage", recorder: "Recorder", say: "Say") -> None:
        """Called after each stage."""
        from rfca_rig.analysis.phases import describe_stroke, stroke_valley
        from rfca_rig.protocol.plan import Flap

        if isinstance(stage, Flap):
            stroke = recorder.strokes[-1]
            # Found once: it takes a tenth of the time of a simulated stroke.
            valley = stroke_valley(stroke)
            self.rows.append(describe_stroke(stroke, valley))
            say(f"{stage.label}: {valley_text(valley)}")


def valley_text(valley: "Valley | Undetermined") -> str:
    """A valley, or why there is none, for a line of output."""
    from rfca_rig.analysis.phases import Valley

    if isinstance(valley, Valley):
        return f"valley ({valley.time_s:.3f} s, {valley.fz_N:.2f} N)"
    return f"no valley: {valley.reason}"


@dataclass(frozen=True)
class FinishedStrokes:
    """What the last lines say of a run.

    Parameters
    ----------
    mark
        SIM or REAL.
    folder
        Of the run.
    rows
        A row of numbers per stroke.
    since_reference
        What has changed; None where the rig has no reference.
    """

    mark: str
    folder: Path
    rows: list[dict[str, float | None]]
    since_reference: SinceReference | None


def _close(run: FinishedStrokes, report: Path | None, as_json: bool) -> None:
    """Prints the last lines: what has changed, where the recording is, and what to type next."""
    import json

    if report is not None:
        from rfca_rig.cli.commands.report import write
        from rfca_rig.reports.problems import ComparisonOptions

        write([run.folder], report, ComparisonOptions(), as_json=False, quiet=as_json)
    if as_json:
        answer: dict[str, Any] = {"source": run.mark, "run": str(run.folder), "strokes": run.rows}
        if run.since_reference is not None:
            answer["since_reference"] = run.since_reference.plain()
        echo(json.dumps(answer, indent=1))
        return
    if run.since_reference is not None:
        echo(f"{run.mark} {run.since_reference.line()}", err=True)
    if report:
        following = f"open {report / 'report.html'}"
    else:
        following = f"next: rfca-rig report {run.folder} --out report"
    echo(f"{run.mark} recorded {len(run.rows)} strokes in {run.folder}; {following}", err=True)
