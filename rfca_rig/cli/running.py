"""What both experiments share: print the plan, arm, run, record, close with the next command to type."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import typer

from rfca_rig.bench import provenance
from rfca_rig.bench.expectation import expected_loads
from rfca_rig.bench.make import open_bench
from rfca_rig.bench.recorder import Recorder
from rfca_rig.bench.stage_photos import photo_hashes
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
from rfca_rig.recording import run_folder
from rfca_rig.recording.ballast import check_room
from rfca_rig.recording.form import Recording
from rfca_rig.recording.keeper import DirectKeeper, Keeper
from rfca_rig.recording.photo_store import PhotoStore
from rfca_rig.recording.process_keeper import ProcessKeeper, can_be_started
from rfca_rig.recording.run_text import Ending, write_ending
from rfca_rig.vision.leg_photo import Eye

ROUGHER_STDS = 2.0


@dataclass(frozen=True)
class Order:
    """What the command line asked for: the files as read, their text for the recording, where runs go, how to speak.

    A `model` replaces what the rig file believes; a twin stays what its rig file says. `eye` is there where photos are to be taken,
    with the text of the camera's calibration.
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
    eye: Eye | None = None
    camera_text: str = ""

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
    _check_on_rougher_floor(order)
    _print_plan(order, expected, say)
    check_room(order.runs, _bytes(order))
    if order.dry:
        return None, None
    if order.rig.is_real:
        _arm(order)
    return _record(order, on_stage)


def _check_on_rougher_floor(order: Order) -> None:
    """Whether a leg that is turned back slides or wedges hangs on little friction: the plan must pass with what may be there, too."""
    known_to, rig = order.believes.known_to, order.believes.model()
    if not order.plan.holds or known_to is None or not known_to.friction_coefficient:
        return
    friction = rig.ground.friction_coefficient + ROUGHER_STDS * known_to.friction_coefficient
    rougher = replace(rig, ground=replace(rig.ground, friction_coefficient=friction))
    supposing = f" with a friction of {friction:.2f}, which is {ROUGHER_STDS:g} standard deviations above the believed"
    check_plan(order.plan, expected_loads(order.plan, rougher), supposing)


def _print_plan(order: Order, expected: Mapping[Stage, Load], say: Say) -> None:
    plan, limits = order.plan, order.plan.limits
    say(f"{order.rig.rig.title}: {plan.title}, {len(plan.flaps)} strokes, {len(plan.holds)} static stages, {len(plan.stages)} steps in all")
    for line in _conditions(plan, expected):
        say(f"  {line}")
    say(
        f"  limits {limits.force_N:g} N, {limits.torque_Nm:g} N m, {limits.speed_rad_s:g} rad/s; "
        f"at most {plan.duration_s / 60:.1f} min on the rig, {_bytes(order) / 1e6:.1f} MB before compression"
    )


def _bytes(order: Order) -> int:
    """What the run records, before compression."""
    width, height = order.eye.camera.image_size_px if order.eye else (0, 0)
    return order.plan.recorded_bytes + 3 * width * height * order.plan.photos


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
    with open_bench(order.rig, order.twin_seed, order.eye) as bench:
        if bench.is_real:
            marked(order.mark, order.quiet)(f"the drive's watchdog stops the motor after {prove_stop(bench):.2f} s of silence")
        run_folder.create(folder, _header(order, bench))
        keeper = _keeper(folder, bench)
        recorder = Recorder(keeper, bench.sensor.scale(), bench.clock, PhotoStore(folder) if bench.camera else None)
        with progress_bar(order.mark, order.plan.duration_s, order.quiet) as (advance, say):

            def progress(stage: Stage) -> None:
                advance(stage.label, stage.duration_s)
                on_stage(stage, recorder, say)

            try:
                recorder.note("run begins", title=order.plan.title, source=order.mark)
                run_plan(order.plan, bench, recorder, progress)
                recorder.note("motor off", worst_loop_gap_ms=round(1e3 * recorder.worst_gap_s, 3))
            except RigError as error:
                _keep(order, Kept(folder, keeper, recorder, bench), say, str(error))
                raise
            except BaseException as mistake:
                keeper.finish(f"ended by {type(mistake).__name__}")
                raise
        _finish(order, Kept(folder, keeper, recorder, bench), "done")
    return folder, recorder


def _keeper(folder: Path, bench: Bench) -> Keeper:
    """A twin's time stands still while it waits for the disk; a real rig must not wait."""
    return ProcessKeeper(folder, patient=not bench.is_real) if can_be_started() else DirectKeeper(folder)


@dataclass(frozen=True)
class Kept:
    """What a run leaves behind when the motor is off."""

    folder: Path
    keeper: Keeper
    recorder: Recorder
    bench: Bench


def _finish(order: Order, run: Kept, why: str) -> None:
    """The recording as a whole, with what the photos show. Raises RigError with what to do where the disk has no room for it."""
    try:
        run.keeper.finish(why)
        _read_photos(order, run)
        _put_together(run, why)
    except RigError as error:
        safe = f"{run.keeper.acknowledged} stages are safe in {run.folder}"
        raise type(error)(f"{error}; {safe}, type rfca-rig recover {run.folder} (where the disk is full, make room first)") from error


def _put_together(run: Kept, why: str) -> None:
    known = {**provenance.ended(run.bench, why, run.recorder.worst_gap_s), **provenance.devices(run.bench), **provenance.streams(run.bench)}
    write_ending(run.folder, Ending({**known, **photo_hashes(run.folder)}, tuple(run.recorder.stages)))
    run_folder.build(run.folder)


def _read_photos(order: Order, run: Kept) -> None:
    if order.eye is not None:
        marked(order.mark, order.quiet)(f"motor off; reading {sum(bool(stage.photo) for stage in run.recorder.stages)} photos ...")
        run.recorder.read_photos(run.folder, order.eye)


def _keep(order: Order, run: Kept, say: Say, why: str) -> None:
    """A run cut short keeps what it recorded; one that recorded nothing leaves nothing behind."""
    try:
        if run.recorder.samples:
            _finish(order, run, why)
            say(f"kept {_counted(run.folder)} in {run.folder}")
        else:
            run.keeper.finish(why)
            _read_photos(order, run)
            run_folder.discard(run.folder)
    except RigError as also:
        say(str(also))


def _counted(folder: Path) -> str:
    kept = run_folder.read_stages(folder)
    cut_short = "".join(f", and {raw.label} until it was cut short," for raw in kept.raw if raw.cut_short)
    return f"{len(kept.strokes)} strokes and {len(kept.static)} static stages{cut_short}"


def _header(order: Order, bench: Bench) -> Recording:
    known_to = order.believes.known_to.model_dump(exclude_none=True) if order.believes.known_to else {}
    seed = {} if order.twin_seed is None else {"seed": str(order.twin_seed)}
    texts = {"rig_file": order.rig_text, "protocol_file": order.protocol_text}
    texts |= ({"model_file": order.model_text} if order.model else {}) | ({"camera_file": order.camera_text} if order.eye else {})
    return Recording(
        title=order.plan.title,
        source="REAL" if order.rig.is_real else "SIM",
        believed=order.believes.believed(),
        known_to=known_to,
        strokes=(),
        static=(),
        provenance={
            **provenance.made_by(bench),
            **provenance.files(texts),
            **provenance.planned(order.plan),
            **provenance.devices(bench),
            **seed,
        },
    )
