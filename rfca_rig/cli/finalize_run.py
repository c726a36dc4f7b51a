"""Completes a run when the motor is off: the recording as a whole, also of a run that was cut
short.

Lines about a stage are held back until the recorder has acknowledged that the stage is on disk.
"""

from collections import deque
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from rfca_rig.bench import provenance
from rfca_rig.bench.provenance import Outcome
from rfca_rig.bench.recorder import Recorder
from rfca_rig.bench.resume import InterruptedRun, ending_of, reopen_run
from rfca_rig.bench.rig_compatibility import (
    CALIBRATION_KEY,
    Change,
    Noted,
    changes_of_event,
    compare_devices,
    compare_software,
)
from rfca_rig.cli.progress import make_marked_say, progress
from rfca_rig.cli.run_config import RunConfig
from rfca_rig.cli.terminal import Say
from rfca_rig.clock import Clock
from rfca_rig.devices.own import packages_of, texts_of
from rfca_rig.engine.interfaces import Bench, StopLevel, StopRequest
from rfca_rig.errors import DiskFull, RigError, Tripped
from rfca_rig.model.catalogue import lab_texts
from rfca_rig.progress import ProgressCount, ignore_progress
from rfca_rig.recording import run_folder
from rfca_rig.recording.backend import SILENT_S, RunBackend
from rfca_rig.recording.layout import RECORDING
from rfca_rig.recording.model import Recording
from rfca_rig.recording.run_text import write_ending
from rfca_rig.recording.store import summarize
from rfca_rig.recording.tables import CYCLES

# Half of the time for which the queue takes everything that a 15 kHz sensor sends: what the stop
# takes still fits.
STOP_S = 10.0


class AcknowledgedLines:
    """A power cut must not cost a stage that was announced, so no line comes before the
    acknowledgement of its stage.

    A recorder that acknowledges nothing for `SILENT_S` is reported; after `STOP_S` the run stops at
    the next safe point. Both are looked at between stages, because printing may block and the
    control loop must not.
    """

    def __init__(
        self,
        say: Say,
        keeper: RunBackend,
        recorder: Recorder,
        stop_request: StopRequest,
        clock: Clock,
    ) -> None:
        self._say = say
        self._keeper = keeper
        self._recorder = recorder
        self._stop_request = stop_request
        self._clock = clock
        self._waiting: deque[tuple[int, float, str]] = deque()
        self._is_silent = False

    def hold(self, line: str) -> None:
        """Take a line about the stage that was handed over last."""
        self._waiting.append((self._recorder.ended, self._clock.now_s(), line))

    def release(self) -> None:
        """Print what is acknowledged by now, and report a recorder that is silent."""
        self._print_acknowledged()
        if not self._waiting:
            self._is_silent = False
            return
        number, since_s, _ = self._waiting[0]
        silent_s = self._clock.now_s() - since_s
        stages = self._recorder.ended - number + 1
        if silent_s > SILENT_S and not self._is_silent:
            self._is_silent = True
            self._say(
                f"the disk is silent: {stages} stage{'s' * (stages > 1)} done, not on "
                f"disk since {silent_s:.0f} s"
            )
        if silent_s > STOP_S:
            self._stop_request.ask(
                StopLevel.SAFE_POINT, f"the disk has acknowledged nothing for {silent_s:.0f} s"
            )

    def close(self) -> None:
        """Print what is acknowledged once the recorder has ended, and count what is not."""
        self._print_acknowledged()
        if self._waiting:
            self._say(
                f"{self._recorder.ended - self._waiting[0][0] + 1} stages were done and "
                "are not on disk: the recorder failed"
            )
            self._waiting.clear()

    def _print_acknowledged(self) -> None:
        while self._waiting and self._waiting[0][0] <= self._keeper.acknowledged:
            self._say(self._waiting.popleft()[2])


def open_folder(config: RunConfig, folder: Path, bench: Bench) -> None:
    if config.begun is None:
        run_folder.create(folder, _header(config, bench))
    else:
        changes, noted = compare_devices_with_run(config, config.begun, bench)
        software = compare_software(config.begun, provenance.software_and_host(bench))
        reopen_run(
            config.begun,
            bench.clock,
            provenance.operator(config.operator),
            config.twin_seed,
            changes_of_event(
                {**config.rig_changes, **changes}, {**config.noted_changes, **noted, **software}
            ),
            config.zero_facts,
        )


def compare_devices_with_run(
    config: RunConfig, begun: InterruptedRun, bench: Bench
) -> tuple[Mapping[str, Change], Noted]:
    """Accepted and harmless differences of the devices. Raises BadInput for others."""
    return compare_devices(
        begun, provenance.devices(bench), config.rig_name, config.accepts_changes
    )


def note_end(recorder: Recorder, why: str) -> None:
    """Records what ended the motion and how the shaft came to rest."""
    # A recorder that has failed was reported already; it must not hide the reason of the stop.
    with suppress(RigError):
        recorder.note(
            "motor off",
            why=why,
            worst_loop_gap_ms=round(1e3 * recorder.worst_gap_s, 3),
            standstill=recorder.standstill.text(),
            tare_drift=recorder.tare_drift(),
        )


@dataclass(frozen=True)
class FinishedRun:
    """Results and devices of a run when the motor is off."""

    folder: Path
    keeper: RunBackend
    recorder: Recorder
    bench: Bench
    lines: AcknowledgedLines
    outcome: Outcome


def finish(config: RunConfig, run: FinishedRun, quiet: bool = False) -> None:
    """Completes the recording, with the angles from the photos. Raises RigError with the remedy
    where the disk has no room for it.

    Shows its progress unless `quiet`, for example below another progress bar.
    """
    try:
        # Order: all blocks on disk, then photos, then `run.h5`. Each needs the result of the one
        # before.
        try:
            run.keeper.finish(run.outcome.why)
        finally:
            run.lines.close()
        with progress(config.quiet or quiet) as bars:
            _read_photos(config, run, bars.counting("reading photos"))
            _put_together(config, run, bars.counting("stages into run.h5"))
    except RigError as error:
        safe = f"{run.keeper.acknowledged} stages are safe in {run.folder}"
        kind = DiskFull if isinstance(error, DiskFull) else RigError
        raise kind(
            f"{error}; {safe}, type rfca-rig recover {run.folder} (where the disk is "
            "full, make room first)"
        ) from error


def _put_together(config: RunConfig, run: FinishedRun, report_progress: ProgressCount) -> None:
    recorder = run.recorder
    known = {
        **provenance.ending_fields(run.bench, run.outcome),
        **provenance.loop_fields(recorder.gaps),
        "ended_in_stage": recorder.where,
        "standstill": recorder.standstill.text(),
        "tare_drift": recorder.tare_drift(),
        **provenance.devices(run.bench),
        **provenance.streams(run.bench),
        "bad_samples": recorder.bad_samples,
        "recorder_samples": f"{recorder.samples} handed over, {recorder.refused} refused",
    }
    write_ending(
        run.folder, ending_of(run.folder, known, run.recorder.stages, config.begun, config.eye)
    )
    run_folder.build_recording(run.folder, report_progress)


def _read_photos(config: RunConfig, run: FinishedRun, report_progress: ProgressCount) -> None:
    if config.eye is not None:
        make_marked_say(config.mark, config.quiet)(
            "motor off; reading "
            f"{sum(bool(stage.photo) for stage in run.recorder.stages)} photos ..."
        )
        run.recorder.read_photos(run.folder, config.eye, report_progress)


def finish_cut_short(config: RunConfig, run: FinishedRun, say: Say) -> None:
    """Completes a run that was cut short; one that recorded nothing leaves no folder, except
    after a trip.
    """
    is_tripped = run.outcome.exit_status == Tripped.exit_code
    try:
        # A trip must be on record, also one on the way to the first stage. The folder of a
        # continued run has earlier stages.
        if run.recorder.samples or config.begun or is_tripped:
            finish(config, run, quiet=True)
            after = ""
            if is_tripped:
                after = " --after-trip"
            say(
                f"kept {describe_contents(run.folder)} in {run.folder}; rfca-rig resume "
                f"{run.folder}{after} goes on"
            )
        else:
            run.keeper.finish(run.outcome.why)
            _read_photos(config, run, ignore_progress)
            run_folder.discard(run.folder)
    # Said, not raised: the error that ended the run is the one to be reported.
    except RigError as also:
        say(str(also))


def describe_contents(folder: Path) -> str:
    """What a run has recorded, in words."""
    summary = summarize(folder / RECORDING, thorough=False)
    cut_short = "".join(f", and {label} until it was cut short," for label in summary.cut_short)
    if summary.samples.get(CYCLES):
        cycles = f"{summary.samples[CYCLES]} cycles, "
    else:
        cycles = ""
    return f"{cycles}{summary.strokes} strokes and {summary.static} static stages{cut_short}"


def _header(config: RunConfig, bench: Bench) -> Recording:
    named = {"watchdog_ms": f"{1e3 * config.rig.watchdog_s:g}"}
    if config.twin_seed is not None:
        named["seed"] = str(config.twin_seed)
    if config.rig_name:
        named["rig"] = config.rig_name
    if config.faults:
        named["twin_faults"] = ", ".join(
            f"{fault.words} at {fault.at_s:g} s" for fault in config.faults
        )
    if config.rig.sensor.checked:
        named["sensor_checked"] = config.rig.sensor.checked.describe()
    # The driver of an installed package is no text of the rig: its version says what ran.
    named |= packages_of(config.rig.motor, config.rig.force_sensor)
    texts = {"rig_file": config.rig_text, "protocol_file": config.protocol_text}
    if config.model:
        texts["model_file"] = config.model_text
    if config.eye:
        texts["camera_file"] = config.camera_text
    if config.camera_path:
        named[CALIBRATION_KEY] = config.camera_path
    # A lab's own drivers and effects are part of the rig: without their text the recording could
    # not be explained.
    texts |= texts_of(config.rig.motor, config.rig.force_sensor)
    effect_texts = lab_texts([effect.id for effect in config.nominal_source.effects])
    texts |= {f"effect_{name}_file": text for name, text in effect_texts.items()}
    return Recording(
        title=config.plan.title,
        source=config.rig.source,
        nominal=config.nominal_source.nominal(),
        known_to=config.known_to,
        strokes=(),
        static=(),
        provenance={
            **provenance.software_and_host(bench),
            **provenance.operator_and_sample(config.operator, config.sample),
            **provenance.files(texts),
            **provenance.plan_fields(config.plan),
            **provenance.devices(bench),
            **config.zero_facts,
            **named,
        },
    )
