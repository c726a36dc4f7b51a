"""What both experiments share: print the plan, arm, run, record, close with the next command to type."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

import typer

from rfca_rig import __version__
from rfca_rig.bench.expectation import expected_loads
from rfca_rig.bench.make import open_bench
from rfca_rig.bench.recorder import Recorder
from rfca_rig.cli.places import new_run_folder
from rfca_rig.cli.terminal import Say, marked, progress_bar
from rfca_rig.description.model_file import ModelFile
from rfca_rig.description.rig_file import RigFile
from rfca_rig.engine.arming import prove_stop
from rfca_rig.engine.bench import Bench
from rfca_rig.engine.run import run_plan
from rfca_rig.errors import BadInput, RigError
from rfca_rig.model.compiled import is_warm
from rfca_rig.protocol.check import Load, check_plan
from rfca_rig.protocol.plan import Flap, Hold, Plan, Stage
from rfca_rig.recording.form import Recording
from rfca_rig.recording.run_file import RunFile

RECORDING = "run.h5"


@dataclass(frozen=True)
class Order:
    """What the command line asked for: the files as read, their text for the recording, where runs go, how to speak.

    A `model` replaces what the rig file believes; a twin stays what its rig file says.
    """

    rig: RigFile
    rig_text: str
    protocol_text: str
    plan: Plan
    seed: int | None
    runs: Path
    quiet: bool
    dry: bool
    model: ModelFile | None = None
    model_text: str = ""

    @property
    def believes(self) -> RigFile | ModelFile:
        """Whose model the run is expected to follow."""
        return self.model or self.rig

    @property
    def mark(self) -> str:
        """SIM or REAL, at the head of every line."""
        return "REAL" if self.rig.is_real else "SIM"

    @property
    def twin_seed(self) -> int | None:
        """The seed of this run, None on a real rig."""
        if self.rig.twin is None or self.rig.is_real:
            return None
        return self.rig.twin.seed if self.seed is None else self.seed


def carry_out(order: Order, on_stage: Callable[[Stage, Recorder, Say], None]) -> tuple[Path | None, Recorder | None]:
    """The whole way from the printed plan to the finished recording; (None, None) after a dry run."""
    say = marked(order.mark, order.quiet)
    if not is_warm():
        say("compiling the model, once on this machine, about ten seconds ...")
    expected = expected_loads(order.plan, order.believes.model())
    check_plan(order.plan, expected)
    _print_plan(order, expected, say)
    if order.dry:
        return None, None
    if order.rig.is_real:
        _arm(order)
    return _record(order, on_stage)


def _print_plan(order: Order, expected: Mapping[Stage, Load], say: Say) -> None:
    plan, limits = order.plan, order.plan.limits
    say(f"{order.rig.rig.title}: {plan.title}, {len(plan.flaps)} strokes, {len(plan.holds)} static stages, {len(plan.stages)} steps in all")
    for line in _conditions(plan, expected):
        say(f"  {line}")
    say(
        f"  limits {limits.force_N:g} N, {limits.torque_Nm:g} N m, {limits.speed_rad_s:g} rad/s; "
        f"at most {plan.duration_s / 60:.1f} min on the rig, {plan.recorded_bytes / 1e6:.1f} MB before compression"
    )


def _conditions(plan: Plan, expected: Mapping[Stage, Load]) -> list[str]:
    lines: dict[str, int] = {}
    for stage in plan.stages:
        load = expected.get(stage)
        force = "" if load is None else f", model expects up to {load.force_N:.0f} N and {load.torque_Nm:.1f} N m"
        if isinstance(stage, Flap):
            line = f"{1e3 * stage.height_m:.1f} mm, {stage.speed_rad_s:g} rad/s{force}"
        elif isinstance(stage, Hold):
            line = f"{stage.label}{force}"
        else:
            continue
        lines[line] = lines.get(line, 0) + 1
    return [f"{line}, {count} times" if count > 1 else line for line, count in lines.items()]


def _arm(order: Order) -> None:
    """Real hardware moves only after the operator has typed the force limit; nothing is assumed from a pressed key."""
    limit = f"{order.plan.limits.force_N:g}"
    typer.echo("REAL the motor will turn. Emergency stop tested today? Guard closed? Nobody near the leg?", err=True)
    if typer.prompt("REAL type the force limit in newtons to go on", default="", show_default=False, err=True).strip() != limit:
        raise BadInput(f"not armed: the force limit is {limit} N; nothing has moved")


def _record(order: Order, on_stage: Callable[[Stage, Recorder, Say], None]) -> tuple[Path, Recorder]:
    folder = new_run_folder(order.runs, order.mark, order.plan.title)
    with open_bench(order.rig, order.twin_seed) as bench:
        if bench.is_real:
            marked(order.mark, order.quiet)(f"the drive's watchdog stops the motor after {prove_stop(bench):.2f} s of silence")
        file = RunFile.create(folder / RECORDING, _header(order, bench.clock.started_at().isoformat()))
        recorder = Recorder(file, bench.sensor.scale())
        with progress_bar(order.mark, order.plan.duration_s, order.quiet) as (advance, say):

            def progress(stage: Stage) -> None:
                advance(stage.label, stage.duration_s)
                on_stage(stage, recorder, say)

            try:
                run_plan(order.plan, bench, recorder, progress)
            except RigError as error:
                _keep(file, recorder, folder, say, str(error))
                raise
        file.finish({"ended": "done", **_devices(bench)})
    return folder, recorder


def _devices(bench: Bench) -> dict[str, str]:
    """Who measured, and how whole the streams were."""
    health = bench.sensor.health()
    counted = f"{health.received} received, {health.lost} lost, {health.duplicate} twice, {health.out_of_order} out of order"
    motor = {f"motor_{name}": text for name, text in bench.motor.identity().items()}
    sensor = {f"sensor_{name}": text for name, text in bench.sensor.identity().items()}
    bad = f"{health.malformed} malformed, {health.faulty_status} with a bad status, {health.saturated} saturated, {health.stalled} stalled"
    return {**motor, **sensor, "sensor_records": f"{counted}, {bad}"}


def _keep(file: RunFile, recorder: Recorder, folder: Path, say: Say, why: str) -> None:
    """A run cut short keeps what it recorded; one that recorded nothing leaves nothing behind."""
    if recorder.strokes or recorder.stages:
        file.finish({"ended": why})
        say(f"kept {len(recorder.strokes)} strokes and {len(recorder.stages)} static stages in {folder}")
        return
    file.discard()
    folder.rmdir()


def _header(order: Order, started_at: str) -> Recording:
    known_to = order.believes.known_to.model_dump(exclude_none=True) if order.believes.known_to else {}
    seed = {} if order.twin_seed is None else {"seed": str(order.twin_seed)}
    return Recording(
        title=order.plan.title,
        source="REAL" if order.rig.is_real else "SIM",
        believed=order.believes.believed(),
        known_to=known_to,
        strokes=(),
        static=(),
        provenance={
            "rfca_rig_version": __version__,
            "started_at": started_at,
            "rig_file": order.rig_text,
            "protocol_file": order.protocol_text,
            **({"model_file": order.model_text} if order.model else {}),
            **seed,
        },
    )
