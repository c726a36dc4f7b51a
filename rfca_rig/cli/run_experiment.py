"""The steps that all experiments share: plan checked against limits and printed, rig armed, run,
recording completed.
"""

import signal
import sys
from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import replace
from functools import partial
from math import degrees
from pathlib import Path
from types import FrameType

import typer

from rfca_rig.bench.expectation import check_parked_leg, predict_loads
from rfca_rig.bench.factory import open_bench
from rfca_rig.bench.photo_reader import PhotoReader, can_read_beside
from rfca_rig.bench.provenance import Outcome
from rfca_rig.bench.recorder import Recorder
from rfca_rig.bench.zero_check import ZeroOfRun, setup_command
from rfca_rig.cli.attach_view import attach_view, twin_clock
from rfca_rig.cli.finalize_run import (
    AcknowledgedLines,
    FinishedRun,
    compare_devices_with_run,
    finish,
    finish_cut_short,
    note_end,
    open_folder,
)
from rfca_rig.cli.paths import find_file, make_run_folder, trust
from rfca_rig.cli.progress import (
    announce_first_compile,
    compile_ahead,
    make_marked_say,
    progress,
    progress_bar,
)
from rfca_rig.cli.run_config import RunConfig
from rfca_rig.cli.terminal import Say, echo
from rfca_rig.clock import WallClock
from rfca_rig.drivers.roles import ConfiguredSensor
from rfca_rig.engine.interfaces import Bench, StopLevel, StopRequest
from rfca_rig.engine.run import Supervision, prove_stop, run_plan
from rfca_rig.errors import BadInput, RigError
from rfca_rig.protocol.check import Load, check_plan
from rfca_rig.protocol.plan import Cycles, Flap, Hold, Plan, Stage, cycle_bytes
from rfca_rig.recording import run_folder
from rfca_rig.recording.backend import InProcessRecorder, RecorderClient, RunBackend
from rfca_rig.recording.recorder_process import start_recorder
from rfca_rig.recording.run_writer import check_room
from rfca_rig.subprocesses import Helper, can_be_started
from rfca_rig.view.run_queue import check_live_view

# Standard deviations of floor friction above its prior value with which a static plan must pass
# too.
ROUGHER_STDS = 2.0


def condition_lines(plan: Plan, expected: Mapping[Stage, Load]) -> list[str]:
    """A line for each stroke, static stage and block of cycles; moves and rests are omitted."""
    lines: dict[str, int] = {}
    for stage in plan.stages:
        load = expected.get(stage)
        if load is None:
            force = ""
        else:
            force = f", model expects up to {load.force_N:.0f} N and {load.torque_Nm:.1f} N m"
        match stage:
            case Flap():
                line = f"{1e3 * stage.height_m:.1f} mm, {stage.speed_rad_s:g} rad/s{force}"
            case Hold() if plan.experiment == "fatigue":
                line = (
                    f"check at {degrees(stage.angle_rad):.1f} deg, {1e3 * stage.height_m:.1f} "
                    f"mm{force}"
                )
            case Hold():
                line = f"{stage.label}{force}"
            case Cycles():
                line = (
                    f"{1e3 * stage.height_m:.1f} mm, {stage.speed_rad_s:g} rad/s on and on{force}"
                )
            case _:
                continue
        lines[line] = lines.get(line, 0) + getattr(stage, "count", 1)
    return [f"{line}, {count} times" if count > 1 else line for line, count in lines.items()]


def check_before_run(config: RunConfig, say: Say) -> Mapping[Stage, Load]:
    """Predicted load of each stage. Raises BadInput where a load, or the plan itself, passes a
    limit.
    """
    with progress(config.quiet) as bars:
        announce_first_compile(bars, config.quiet, say)
        # Not beside real hardware: nothing may take time from its loop.
        if not config.rig.is_real:
            compile_ahead(config.nominal_source.model())
        expected = predict_loads(config.plan, config.nominal_source.model())
    check_plan(config.plan, expected)
    check_parked_leg(
        config.plan, config.nominal_source.model(), config.rig.facts().parked_angle_rad
    )
    _check_on_rougher_floor(config)
    return expected


def _check_on_rougher_floor(config: RunConfig) -> None:
    """Whether a leg that is turned back slides or wedges depends on little friction: the plan
    must pass with more of it, too.
    """
    known_to = config.nominal_source.known_to
    rig = config.nominal_source.model()
    if not config.plan.holds or known_to is None or not known_to.friction_coefficient:
        return
    friction = rig.ground.friction_coefficient + ROUGHER_STDS * known_to.friction_coefficient
    rougher = replace(rig, ground=replace(rig.ground, friction_coefficient=friction))
    supposing = (
        f" with a friction of {friction:.2f}, which is {ROUGHER_STDS:g} standard deviations "
        "above the nominal one"
    )
    check_plan(config.plan, predict_loads(config.plan, rougher), supposing)


def print_plan(config: RunConfig, expected: Mapping[Stage, Load], say: Say) -> None:
    plan = config.plan
    limits = config.plan.limits
    counts = (
        f"{len(plan.flaps)} strokes, {len(plan.holds)} static stages, {len(plan.stages)} "
        "steps in all"
    )
    say(f"{config.rig.rig.title}: {plan.title}, {counts}")
    for line in condition_lines(plan, expected):
        say(f"  {line}")
    say(
        f"  limits {limits.force_N:g} N, {limits.torque_Nm:g} N m, {limits.speed_rad_s:g} rad/s; "
        f"at most {plan.duration_s / 60:.1f} min on the rig, "
        f"{recording_size(config) / 1e6:.1f} MB before compression"
    )


def recording_size(config: RunConfig) -> int:
    """Size of the recording in bytes, before compression."""
    if config.eye:
        width, height = config.eye.camera.image_size_px
    else:
        width = 0
        height = 0
    return (
        config.plan.recorded_bytes
        + cycle_bytes(config.plan)
        + 3 * width * height * config.plan.photos
    )


OUTSIDE = {signal.SIGTERM: "ended by SIGTERM"}

CHECKLIST = "Emergency stop tested today? Guard closed? Nobody near the leg?"


if sys.platform != "win32":  # which has no SIGHUP
    OUTSIDE[signal.SIGHUP] = "its terminal was closed (SIGHUP)"


class SignalHandler:
    """Turns a signal into a stop request.

    Where the loop does not tick, the run waits for a person with its motor off; it is then
    interrupted at once.
    """

    def __init__(self, stop_request: StopRequest, say: Say) -> None:
        self._stop_request = stop_request
        self._say = say
        self._presses = 0
        self._is_closing = False

    def begin_closing(self) -> None:
        """The motor is off, and everything recorded is handed over."""
        self._presses = 0
        self._is_closing = True

    def key(self, _number: int, _frame: FrameType | None) -> None:
        """^C: once for the next safe point, twice for now, three times where a device hangs."""
        if self._is_closing:
            # The motor is off and everything is handed over: the second ^C leaves the rest to
            # `rfca-rig recover`.
            self._presses += 1
            if self._presses > 1:
                raise KeyboardInterrupt
            self._say(
                "the recording is being finished; ^C again ends here and leaves the rest "
                "to rfca-rig recover"
            )
            return
        # The stop is under way: an interruption now could skip the torque-off.
        if self._stop_request.is_over:
            return
        self._presses += 1
        if self._presses == 1 and self._stop_request.is_ticking:
            self._stop_request.ask(StopLevel.SAFE_POINT, "stopped by the operator")
            self._say("stopping at the next safe point; ^C again takes the torque away now")
            return
        self._stop_request.ask(StopLevel.TORQUE_OFF, "stopped at once by the operator")
        if self._presses > 2 or not self._stop_request.is_ticking:
            # The loop sees no request: it waits for a person, or hangs in a device. Only an
            # exception gets through.
            raise KeyboardInterrupt

    def from_outside(self, number: int, _frame: FrameType | None) -> None:
        """The system ends the process: the shaft is slowed down, then the motor is disabled."""
        if self._is_closing:
            self._say("the recording is being finished; then the run ends")
            return
        if self._stop_request.is_over:
            return
        self._stop_request.ask(StopLevel.RAMP_DOWN, OUTSIDE[signal.Signals(number)])
        if not self._stop_request.is_ticking:
            raise KeyboardInterrupt


@contextmanager
def handle_signals(stop_request: StopRequest, say: Say) -> Iterator[SignalHandler]:
    """Within the block, signals become stop requests; afterwards the earlier handlers are
    restored.
    """
    handler_of_run = SignalHandler(stop_request, say)
    handlers = {
        signal.SIGINT: handler_of_run.key,
        **dict.fromkeys(OUTSIDE, handler_of_run.from_outside),
    }
    # Installed only around the run: elsewhere ^C keeps its usual meaning.
    before = {number: signal.signal(number, handler) for number, handler in handlers.items()}
    try:
        yield handler_of_run
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def ask_operator(config: RunConfig) -> None:
    """Real hardware moves only after the operator has typed the force limit; pressing a key by
    habit is not enough.
    """
    limit = f"{config.plan.limits.force_N:g}"
    echo(f"REAL the motor will turn. {CHECKLIST}", err=True)
    if (
        typer.prompt(
            "REAL type the force limit in newtons to go on",
            default="",
            show_default=False,
            err=True,
        ).strip()
        != limit
    ):
        raise BadInput(f"not armed: the force limit is {limit} N; nothing has moved")


def warn_of_sensor(config: RunConfig, bench: Bench) -> None:
    """Prints what the sensor's own settings do to the forces. Raises RigError where they contradict
    the rig file.
    """
    if isinstance(bench.sensor, ConfiguredSensor):
        say = make_marked_say(config.mark, config.quiet)
        for warning in bench.sensor.check_configuration():
            say(f"force sensor: {warning}")


def prove_drive(config: RunConfig, bench: Bench) -> dict[str, str | float]:
    """Results of the arming for the run's events: the confirmation, and the drive's own stop."""
    watchdog_s = prove_stop(bench)
    is_guarded = bench.motor.identity().get("guardian", "none") != "none"
    if is_guarded:
        who = "the guardian disables the motor"
    else:
        who = "the drive's watchdog stops the motor"
    make_marked_say(config.mark, config.quiet)(f"{who} after {watchdog_s:.2f} s of silence")
    return {
        "confirmed": CHECKLIST,
        "by_typing_N": config.plan.limits.force_N,
        "watchdog_s": round(watchdog_s, 3),
    }


def run_and_record(
    config: RunConfig, on_stage: Callable[[Stage, Recorder, Say], None]
) -> tuple[Path | None, Recorder | None]:
    """From the printed plan to the finished recording; (None, None) after a dry run.

    Parameters
    ----------
    config : RunConfig
        The run.
    on_stage : callable
        Called after each stage with the stage, the recorder and a function that prints a line.

    Returns
    -------
    tuple of Path and Recorder
        The run's folder, and what it recorded.
    """
    if config.viewing is not None:
        check_live_view()
    say = make_marked_say(config.mark, config.quiet)
    with _start_recorder(config) as started:
        expected = check_before_run(config, say)
        print_plan(config, expected, say)
        # All checks come before the operator is asked to arm the rig.
        check_room(config.runs, recording_size(config))
        if config.dry:
            return None, None
        if config.rig_name:
            trust(find_file("calibration", config.rig_name))
        zero = ZeroOfRun(config.rig, config.rig_path)
        zero.check_before_arming()
        if config.rig.is_real:
            _say_without_policy(config, say)
            ask_operator(config)
        return _record(config, started, Supervision(expected), zero, on_stage)


def _say_without_policy(config: RunConfig, say: Say) -> None:
    """A real rig whose file does not say what becomes of its zero runs as ever, but not without a
    word.
    """
    if config.rig.motor.zero_policy is None:
        say(
            "zero_policy is missing under [motor], so a power-up of the drive is not looked for; "
            f"check its zero after each: {setup_command(config.rig_path)}"
        )


@contextmanager
def _start_recorder(config: RunConfig) -> Iterator[Helper | None]:
    """Within the block, a recorder process that imports its modules while the plan is checked;
    it ends where it gets nothing to record.
    """
    started = None
    # A system that refuses the process now is asked again, and its answer reported, when there is
    # something to record.
    with suppress(OSError):
        if can_be_started() and not config.dry:
            started = start_recorder()
        else:
            started = None
    try:
        yield started
    finally:
        if started is not None:
            process, connection = started
            connection.close()
            # It notices the end of the connection, and would be a zombie until this process ends.
            process.wait()


def _record(
    config: RunConfig,
    started: Helper | None,
    supervision: Supervision,
    zero: ZeroOfRun,
    on_stage: Callable[[Stage, Recorder, Say], None],
) -> tuple[Path, Recorder]:
    with (
        open_bench(
            config.rig, config.twin_seed, config.eye, twin_clock(config), config.faults
        ) as bench,
        attach_view(config, bench, supervision.stop_request) as view,
        ExitStack() as signals,
        ExitStack() as helpers,
    ):
        # Before the folder is made: a sensor or drive that is refused leaves no empty run behind.
        warn_of_sensor(config, bench)
        if config.begun is not None:
            # Before anything is energised. What a drive tells only then is compared afterwards.
            compare_devices_with_run(config, config.begun, bench)
        config = replace(config, zero_facts=zero.check_drive(bench))
        armed = prove_drive(config, bench) if bench.is_real else {}
        folder, keeper = _begin_recording(config, bench, started)
        reader = _start_photo_reader(config, folder, helpers)
        keeper.watch(supervision.helpers)
        if reader is not None:
            reader.watch(supervision.helpers)
        recorder = Recorder(keeper, bench.sensor.scale(), bench.clock, reader)
        with progress_bar(config.mark, config.plan.duration_s, config.quiet) as (
            advance,
            say_in_terminal,
        ):
            say = view.begin(keeper, say_in_terminal)

            handlers = signals.enter_context(handle_signals(supervision.stop_request, say))
            lines = AcknowledgedLines(say, keeper, recorder, supervision.stop_request, WallClock())
            run = partial(FinishedRun, folder, keeper, recorder, bench, lines)

            def progress(stage: Stage) -> None:
                advance(stage.label, stage.duration_s)
                on_stage(stage, recorder, lines.hold)
                lines.release()

            try:
                if config.begun is None:
                    recorder.note("run begins", title=config.plan.title, source=config.mark)
                if armed:
                    recorder.note("armed", **armed)
                run_plan(
                    config.plan,
                    bench,
                    recorder,
                    progress,
                    replace(supervision, observer=view.observer),
                )
                handlers.begin_closing()
                # Only now: `run_plan` has returned, so the motor is without torque.
                view.over(None)
                note_end(recorder, "done")
                _store_zero(zero, bench)
            except RigError as error:
                handlers.begin_closing()
                view.over(error)
                note_end(recorder, str(error))
                _store_zero(zero, bench)
                say(f"motor off: {recorder.standstill.text()}")
                # A trip or a stop still gives a recording, which `resume` continues.
                finish_cut_short(config, run(Outcome.of(error)), say)
                raise
            # A defect of this program: the files are closed in order, and the error passes on
            # unchanged.
            except BaseException as mistake:
                keeper.finish(f"ended by {type(mistake).__name__}")
                raise
        finish(config, run(Outcome.of(None)))
    return folder, recorder


def _store_zero(zero: ZeroOfRun, bench: Bench) -> None:
    """Where the run left the encoder. A drive or a disk that fails now must not hide how the run
    ended: without it the next run asks for a check of the zero.
    """
    with suppress(RigError):
        zero.store_end(bench)


def _start_photo_reader(config: RunConfig, folder: Path, helpers: ExitStack) -> PhotoReader | None:
    """On a twin, a process that reads the photos during the run; a real rig leaves its cores to
    the control loop.
    """
    if config.eye is None or config.rig.is_real or not config.plan.photos or not can_read_beside():
        return None
    return helpers.enter_context(PhotoReader(folder, config.eye))


def _begin_recording(
    config: RunConfig, bench: Bench, started: Helper | None
) -> tuple[Path, RunBackend]:
    """The run's folder, and what records into it. Where that cannot begin, the folders that were
    made for it are removed again.
    """
    say = make_marked_say(config.mark, config.quiet)
    if config.begun:
        open_folder(config, config.begun.folder, bench)
        return config.begun.folder, _keeper(config.begun.folder, bench, say, started)
    made = [folder for folder in (config.runs, *config.runs.parents) if not folder.exists()]
    folder = make_run_folder(config.runs, config.mark, config.plan.title)
    try:
        open_folder(config, folder, bench)
        return folder, _keeper(folder, bench, say, started)
    except BaseException:
        with suppress(OSError):
            run_folder.discard(folder)
            for parent in made:
                parent.rmdir()
        raise


def _keeper(folder: Path, bench: Bench, warn: Say, started: Helper | None) -> RunBackend:
    """On a twin the recorder may let the loop wait, as the twin's time stands still meanwhile; a
    real rig must not wait.
    """
    if not can_be_started():
        return InProcessRecorder(folder)
    return RecorderClient(folder, patient=not bench.is_real, warn=warn, started=started)
