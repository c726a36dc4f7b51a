"""The steps of `record`: devices opened, listened to until the end, and the recording completed.

They are those of a run (`run_experiment`) without a plan, limits and an operator who arms the rig:
nothing moves.
"""

import json
import signal
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from types import FrameType

from rfca_rig.bench import provenance
from rfca_rig.bench.listening import (
    ListeningBench,
    open_listening_bench,
    rates_of,
)
from rfca_rig.bench.provenance import Outcome
from rfca_rig.bench.recorder import Recorder
from rfca_rig.cli.paths import find_rig, make_run_folder
from rfca_rig.cli.progress import make_marked_say
from rfca_rig.cli.run_experiment import OUTSIDE
from rfca_rig.cli.terminal import Say
from rfca_rig.clock import TwinClock, WatchedTwinClock
from rfca_rig.description.rig_file import DevicesFile, RigFile, read_devices
from rfca_rig.devices.own import packages_of, texts_of
from rfca_rig.drivers.roles import ForceSamples, ShaftSamples
from rfca_rig.engine.interfaces import StopLevel, StopRequest
from rfca_rig.engine.listening import listen
from rfca_rig.errors import BadInput, RigError
from rfca_rig.recording import run_folder
from rfca_rig.recording.backend import InProcessRecorder, RecorderClient, RunBackend
from rfca_rig.recording.layout import LISTENING, RECORDING
from rfca_rig.recording.model import Recording
from rfca_rig.recording.run_text import Ending, write_ending
from rfca_rig.recording.run_writer import check_room
from rfca_rig.recording.store import summarize
from rfca_rig.subprocesses import HelperWatch, can_be_started
from rfca_rig.toml import read_text

RUNS = Path("runs")
# Without --seconds; forgotten, a recording must not go on for ever.
LONGEST_S = 604_800.0
# For which the disk must have room where no time is given; a full disk ends any recording in order.
ROOM_S = 600.0
BY_OPERATOR = "ended by the operator"


@dataclass(frozen=True)
class ListeningOptions:
    """The options of `record` as typed."""

    rig: str
    seconds: float | None = None
    out: Path | None = None
    pace: float = 1.0
    seed: int | None = None
    operator: str = ""
    sample: str = ""
    is_quiet: bool = False


@dataclass(frozen=True)
class Heard:
    """What was recorded: the run's folder, samples by stream, and why it ended."""

    mark: str
    folder: Path
    samples: Mapping[str, int]
    why: str


def record_listening(asked: ListeningOptions) -> Heard:
    """Records until the time is over or a signal ends it.

    Raises BadInput for a rig file that cannot be used, DeviceError where a device fails; the
    recording is whole all the same.
    """
    rig_path = find_rig(asked.rig)
    rig = read_devices(rig_path)
    check_room(asked.out or RUNS, rates_of(rig).bytes_in(asked.seconds or ROOM_S))
    twin_clock = TwinClock()
    if asked.pace:
        twin_clock = WatchedTwinClock(asked.pace)
    with open_listening_bench(rig, _seed_of(rig, asked.seed), twin_clock) as listening:
        mark = listening.source
        say = make_marked_say(mark, asked.is_quiet)
        folder = _make_folder(asked.out, mark)
        try:
            run_folder.create(folder, _header(rig, rig_path, asked, listening))
            keeper = _start_keeper(folder, listening.bench.is_real, say)
        except BaseException:
            with suppress(OSError):
                run_folder.discard(folder)
            raise
        why = _record(listening, keeper, folder, asked.seconds or LONGEST_S, say)
    summary = summarize(folder / RECORDING, thorough=False)
    return Heard(mark, folder, summary.samples, why)


def _seed_of(rig: RigFile | DevicesFile, seed: int | None) -> int | None:
    if isinstance(rig, DevicesFile) or rig.is_real or rig.twin is None:
        return None
    if seed is None:
        return rig.twin.seed
    return seed


def _make_folder(out: Path | None, mark: str) -> Path:
    if out is None:
        return make_run_folder(RUNS, mark, LISTENING)
    if out.exists():
        raise BadInput(f"{out}: is there already; a recording is never written over")
    out.mkdir(parents=True)
    return out


def _start_keeper(folder: Path, is_real: bool, warn: Say) -> RunBackend:
    if not can_be_started():
        return InProcessRecorder(folder)
    return RecorderClient(folder, patient=not is_real, warn=warn)


def _record(
    listening: ListeningBench, keeper: RunBackend, folder: Path, duration_s: float, say: Say
) -> str:
    """Why the recording ended. Raises RigError where a device failed, when it is whole."""
    bench = listening.bench
    recorder = Recorder(keeper, bench.sensor.scale(), bench.clock)
    stop_request = StopRequest()
    helpers = HelperWatch()
    keeper.watch(helpers)
    failure: RigError | None = None

    def take(shaft: ShaftSamples, force: ForceSamples) -> None:
        recorder.take_rows(listening.make_rows(shaft, force))

    say(f"listening, the motor stays as it is; ^C ends the recording in {folder}")
    with _end_on_signals(stop_request, say):
        recorder.note("run begins", title=LISTENING, source=listening.source)
        try:
            listen(
                bench, duration_s, lambda: listening.begin(recorder), take, stop_request, helpers
            )
        except RigError as error:
            failure = error
        why = stop_request.why or "done"
        if failure is not None:
            why = str(failure)
        # A recorder that has died was the failure; it must not hide its reason.
        with suppress(RigError):
            recorder.end_listening(LISTENING)
            recorder.note("listening ends", why=why)
        _finish(listening, keeper, recorder, folder, failure, why)
    if failure is not None:
        raise failure
    return why


def _finish(
    listening: ListeningBench,
    keeper: RunBackend,
    recorder: Recorder,
    folder: Path,
    failure: RigError | None,
    why: str,
) -> None:
    bench = listening.bench
    keeper.finish(why)
    # A recording that the operator has ended is done: its length was his choice.
    outcome = Outcome.of(failure)
    known = {
        **provenance.ending_fields(bench, outcome),
        **provenance.devices(bench),
        **provenance.streams(bench),
        "recorder_samples": f"{recorder.samples} handed over, {recorder.refused} refused",
    }
    write_ending(folder, Ending(known, ()))
    run_folder.build_recording(folder)


@contextmanager
def _end_on_signals(stop_request: StopRequest, say: Say) -> Iterator[None]:
    """Within the block, ^C and the system's signals end the recording; a second ^C leaves its
    completion to `recover`.
    """
    reasons = {signal.SIGINT: BY_OPERATOR, **OUTSIDE}

    def end(number: int, _frame: FrameType | None) -> None:
        if stop_request.level and number == signal.SIGINT:
            raise KeyboardInterrupt
        stop_request.ask(StopLevel.SAFE_POINT, reasons[signal.Signals(number)])
        say("the recording is being finished; ^C again leaves the rest to rfca-rig recover")

    before = {number: signal.signal(number, end) for number in reasons}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def _header(
    rig: RigFile | DevicesFile, rig_path: Path, asked: ListeningOptions, listening: ListeningBench
) -> Recording:
    bench = listening.bench
    named = {}
    seed = _seed_of(rig, asked.seed)
    if seed is not None:
        named["seed"] = str(seed)
    if asked.rig:
        named["rig"] = asked.rig
    named |= packages_of(rig.motor, rig.force_sensor)
    texts = {"rig_file": read_text(rig_path), **texts_of(rig.motor, rig.force_sensor)}
    stage = {"stage": "Listen", "label": LISTENING, "seconds": asked.seconds}
    return Recording(
        title=f"{rig.rig.title}, {LISTENING}",
        source=listening.source,
        # No model expects anything of a rig that is not moved.
        nominal={},
        known_to={},
        strokes=(),
        static=(),
        provenance={
            **provenance.software_and_host(bench),
            **provenance.operator_and_sample(asked.operator, asked.sample),
            **provenance.files(texts),
            "experiment": LISTENING,
            "plan": json.dumps([stage]),
            **provenance.devices(bench),
            **named,
        },
    )
