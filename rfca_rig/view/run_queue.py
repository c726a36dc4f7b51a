"""The run's end of the view: ticks and events go into a queue in shared memory, and the operator's
stop request comes back.

It costs the loop microseconds a tick, whatever happens to the view. A view that is slow, stopped or
gone leaves a full queue, and what does not fit is dropped. A `LiveView` is started before anything
moves, fed during the run, and left open at the end.
"""

import json
import struct
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from importlib.util import find_spec
from threading import Thread

import numpy as np
from numpy.typing import NDArray

from rfca_rig import subprocesses
from rfca_rig.clock import Clock, WallClock
from rfca_rig.drivers.roles import StreamHealth
from rfca_rig.engine.interfaces import StopLevel, StopRequest, Tick
from rfca_rig.errors import BadInput, RigError
from rfca_rig.protocol.check import Load
from rfca_rig.protocol.plan import Plan, Stage
from rfca_rig.recording.block_queue import BlockQueue
from rfca_rig.recording.journal import BlockKind, JournalBlock, frame_block
from rfca_rig.view.pyramid import Floats, Numbers
from rfca_rig.view.run_facts import MODULE, READY, RunFacts, ViewAssignment, new_token

# Little-endian without padding: eight doubles, the lost records, the numbers of shaft samples and
# of force records.
_HEAD = struct.Struct("<8dQII")
SHAFT_COLUMNS = 5
FORCE_TIMES = 2
AXES = 6

VITALS_EVERY_S = 0.25
# Events that wait for space in the queue; the limit bounds memory where the view is gone for good.
MAX_WAITING = 500

Vitals = Callable[[], tuple[StreamHealth, int]]
WHY = {
    StopLevel.SAFE_POINT: "stopped by the operator, in the view",
    StopLevel.TORQUE_OFF: "stopped at once by the operator, in the view",
}


@dataclass(frozen=True)
class Stamp:
    """What the run adds to a tick: time on the clock that both processes share, and the number
    of force records dropped so far.
    """

    wall_s: float
    lost: int


@dataclass(frozen=True)
class SeenTicks:
    """Consecutive ticks at the view's end, joined. Times of samples are those of the host and of
    the devices.

    One value for each of k ticks, (k,): `wall_s` as stamped; `temperature_C`, NaN where the drive
    does not report it; `shaft_samples` and `force_records`, the numbers that the tick brought; the
    others as in `Tick`. `lost` is that of the last tick. `shaft` (5, m) holds host time, device
    time, angle, speed and torque. `force_host_s` and `force_device_s` are (n,), `counts` (n, 6)
    those of the force sensor.
    """

    wall_s: Floats
    now_s: Floats
    target_rad: Floats
    target_speed_rad_s: Floats
    late_s: Floats
    worst_gap_s: Floats
    temperature_C: Floats
    drive_silent_s: Floats
    lost: int
    shaft_samples: Numbers
    force_records: Numbers
    shaft: Floats
    force_host_s: Floats
    force_device_s: Floats
    counts: NDArray[np.int32]


def tick_block(tick: Tick, stamp: Stamp) -> JournalBlock:
    """A tick as one block. It takes microseconds, because it is called within the control loop."""
    shaft = tick.shaft
    force = tick.force
    status = tick.status
    temperature_C = np.nan
    silent_s = 0.0
    if status is not None:
        silent_s = status.silent_s
        if status.temperature_C is not None:
            temperature_C = status.temperature_C
    head = _HEAD.pack(
        stamp.wall_s,
        tick.now_s,
        tick.target_rad,
        tick.target_speed_rad_s,
        tick.late_s,
        tick.worst_gap_s,
        temperature_C,
        silent_s,
        stamp.lost,
        len(shaft.host_s),
        len(force.host_s),
    )
    columns = (
        shaft.host_s,
        shaft.device_s,
        shaft.angle_rad,
        shaft.speed_rad_s,
        shaft.torque_Nm,
        force.host_s,
        force.device_s,
    )
    pieces = [column.tobytes() for column in columns]
    return JournalBlock(BlockKind.SAMPLES, b"".join((head, *pieces, force.counts.tobytes())))


def ticks_of(blocks: Sequence[JournalBlock]) -> SeenTicks:
    """Decodes one or more blocks. Raises ValueError or struct.error where a block does not hold
    a tick.
    """
    heads = []
    shafts = []
    times = []
    counts = []
    for block in blocks:
        *head, m, n = _HEAD.unpack_from(block.payload)
        heads.append((*head, m, n))
        at = _HEAD.size
        # frombuffer reads without a copy; the concatenation below copies everything once.
        shafts.append(
            np.frombuffer(block.payload, "<f8", SHAFT_COLUMNS * m, at).reshape(SHAFT_COLUMNS, m)
        )
        at += shafts[-1].nbytes
        times.append(
            np.frombuffer(block.payload, "<f8", FORCE_TIMES * n, at).reshape(FORCE_TIMES, n)
        )
        at += times[-1].nbytes
        counts.append(np.frombuffer(block.payload, "<i4", AXES * n, at).reshape(n, AXES))
    (
        wall_s,
        now_s,
        target_rad,
        target_speed_rad_s,
        late_s,
        gap_s,
        temperature_C,
        silent_s,
        lost,
        m,
        n,
    ) = np.array(heads).T
    motion = (target_rad, target_speed_rad_s, late_s, gap_s)
    sizes = (int(lost[-1]), m.astype(np.int64), n.astype(np.int64))
    both = np.concatenate(times, axis=1)
    samples = np.concatenate(shafts, axis=1), both[0], both[1], np.concatenate(counts)
    return SeenTicks(wall_s, now_s, *motion, temperature_C, silent_s, *sizes, *samples)


class RunQueue:
    """Implements `engine.interfaces.RunObserver`.

    `lost` counts force records that the view did not get; the recording has them all. The queue's
    words for acknowledged stages and for a complaint, which a recorder uses, carry the operator's
    stop request and a wanted pause here.
    `vitals` returns the state of the sensor's stream, and the bytes that the recorder is behind.
    `announce` is called with a line of text when a stop is requested.
    """

    def __init__(
        self,
        queue: BlockQueue,
        stages: Sequence[Stage],
        stop_request: StopRequest,
        clock: Clock,
        vitals: Vitals,
        announce: Callable[[str], None],
    ) -> None:
        """`clock` is the one that the view's process has, so that it can compute delays."""
        self._queue = queue
        self._stages = stages
        self._stop_request = stop_request
        self._clock = clock
        self._vitals = vitals
        self._notify = announce
        self._next = 0
        self._vitals_s = -VITALS_EVERY_S
        self._owed: deque[bytes] = deque(maxlen=MAX_WAITING)
        self._is_pause_seen = False
        self.lost = 0

    def stage(self, stage: Stage, expected: Load | None, turns_rad: float | None) -> None:
        load = None
        if expected is not None:
            load = [expected.force_N, expected.torque_Nm]
        self._send_event(
            {
                "about": "stage",
                "number": self._number(stage),
                "label": stage.label,
                "expected": load,
                "turns_rad": turns_rad,
            }
        )
        self._check_stop_request()

    def _number(self, stage: Stage) -> int:
        """Index of a stage in the plan; -1 for one that is not in it, or was passed already."""
        # By identity: a plan may hold equal stages. The search starts after the last one found,
        # because a run only goes forward.
        number = next(
            (
                index
                for index in range(self._next, len(self._stages))
                if self._stages[index] is stage
            ),
            -1,
        )
        self._next = max(self._next, number + 1)
        return number

    def start(self, start_s: float) -> None:
        self._send_event({"about": "start", "start_s": start_s})

    def energising(self) -> None:
        self._check_stop_request()

    def pause(self, is_paused: bool) -> None:
        self._send_event({"about": "pause", "is_paused": is_paused})
        if is_paused:
            self._notify(
                "paused: the motor holds the shaft, limits are checked; "
                "the view lets it go on, ^C stops it"
            )
        else:
            self._notify("the pause is over")

    def tick(self, tick: Tick) -> None:
        now_s = self._clock.now_s()
        if now_s - self._vitals_s >= VITALS_EVERY_S:
            self._vitals_s = now_s
            health, backlog_bytes = self._vitals()
            self._send_event(
                {"about": "vitals", "backlog_bytes": backlog_bytes, "health": asdict(health)}
            )
        # Events that still wait come first: a tick after the start of a stage must not be counted
        # to the stage before.
        if not (
            self._send_waiting()
            and self._queue.put(frame_block(tick_block(tick, Stamp(now_s, self.lost))))
        ):
            self.lost += len(tick.force.host_s)
        self._check_stop_request()

    def line(self, text: str) -> None:
        """A line of text of the run for its operator."""
        self._send_event({"about": "line", "text": text})

    def end(self, why: str, code: str) -> None:
        """The run is over and the motor is off. `code` is the trip code of the limit that was
        exceeded, "" for none.
        """
        self._send_event({"about": "end", "why": why, "code": code})
        self._send_waiting()

    def _send_event(self, event: Mapping[str, object]) -> None:
        self._owed.append(
            frame_block(
                JournalBlock(
                    BlockKind.EVENT, json.dumps({**event, "wall_s": self._clock.now_s()}).encode()
                )
            )
        )
        self._send_waiting()

    def _send_waiting(self) -> bool:
        """Puts waiting events into the queue in order; True where none waits any longer."""
        while self._owed:
            if not self._queue.put(self._owed[0]):
                return False
            self._owed.popleft()
        return True

    def _check_stop_request(self) -> None:
        self._check_pause()
        # The word comes from another process: a larger number is limited to the most urgent stop.
        level = StopLevel(min(self._queue.acknowledged, StopLevel.TORQUE_OFF))
        if level > self._stop_request.level and level in WHY and not self._stop_request.is_over:
            self._stop_request.ask(level, WHY[level])
            when = "now"
            if level is StopLevel.SAFE_POINT:
                when = "at the next safe point"
            self._notify(f"the view asks for a stop {when}")

    def _check_pause(self) -> None:
        is_asked = self._queue.has_complained
        if is_asked == self._is_pause_seen or self._stop_request.is_over:
            return
        self._is_pause_seen = is_asked
        self._stop_request.is_pause_asked = is_asked
        if is_asked:
            self._notify("the view asks for a pause, once the leg is in the air after a stage")
        else:
            self._notify("the view asks to go on")


HOST = "127.0.0.1"
# 6 s of a sensor at 15 kHz.
QUEUE_BYTES = 4 << 20
STARTED_WITHIN_S = 30.0
NEEDED = ("starlette", "uvicorn", "websockets")


def url_of(port: int, token: str) -> str:
    """Address of the page for the operator. A browser keeps the part behind # to itself: no
    request, Referer or log has it.
    """
    return f"http://{HOST}:{port}/#token={token}"


def check_view_is_installed() -> None:
    """Raises BadInput, with the command to install it, where the optional dependency of the view
    is missing.
    """
    # find_spec looks for the packages without importing them: an import takes long, and this
    # process does not need them.
    if any(find_spec(name) is None for name in NEEDED):
        raise BadInput(
            'the view is an extra that is not installed; type pip install "rfca-rig[view]"'
        )


def check_live_view() -> None:
    """The same for the live view of a run, which not every operating system supports."""
    check_view_is_installed()
    if not subprocesses.can_be_started():
        raise BadInput(
            "a run cannot be viewed live on this system; look at its recording "
            "afterwards, with rfca-rig view RUN"
        )


class LiveView:
    """Live view of one run. `run_queue` is the observer for its supervision, `url` the address for
    the operator.

    Close it when the motor is off. A view that ends by itself does not disturb the run; `is_alive`
    shows it.
    """

    def __init__(
        self,
        facts: RunFacts,
        plan: Plan,
        stop_request: StopRequest,
        vitals: Vitals,
        announce: Callable[[str], None],
        port: int,
    ) -> None:
        """Starts the view's process; returns when the page can be opened.

        Parameters
        ----------
        facts
            What is known of the run before it begins.
        plan
            The plan of the run.
        stop_request
            Receives the stop that the operator requests on the page.
        vitals
            Returns the state of the sensor's stream, and the bytes that the recorder is behind.
        announce
            Called with a line of text when the page requests a stop.
        port
            TCP port; 0 for any free one.

        Raises
        ------
        BadInput
            For a port that is in use.
        RigError
            Where the view cannot be started.
        """
        clock = WallClock()
        token = new_token()
        self._queue = BlockQueue.create(QUEUE_BYTES)
        self.run_queue = RunQueue(self._queue, plan.stages, stop_request, clock, vitals, announce)
        try:
            self._process, self._child = subprocesses.spawn(
                MODULE, ViewAssignment(facts, self._queue.name, clock, port, token)
            )
        except OSError as error:
            self._queue.remove()
            raise RigError(f"the view cannot be started: {error}") from error
        self.url = url_of(self._receive_port(), token)

    def _receive_port(self) -> int:
        try:
            if self._child.poll(STARTED_WITHIN_S):
                what, answer = self._child.recv()
            else:
                what = ""
                answer = f"no word within {STARTED_WITHIN_S:g} s"
        # The socket closes when the child ends before it has answered.
        except (EOFError, OSError):
            what = ""
            answer = "it ended by itself"
        if what == READY:
            return int(answer)
        self._process.kill()
        self._process.wait()
        self.close()
        if what:
            raise BadInput(answer)
        raise RigError(f"the view: {answer}")

    @property
    def process_id(self) -> int:
        """Process id of the view, for measuring its cost."""
        return self._process.pid

    @property
    def is_alive(self) -> bool:
        return self._process.poll() is None

    def close(self) -> None:
        """The run is over. The view keeps what it has received, and stays for as long as a page
        is open.
        """
        if not self._child.closed:
            self._child.close()
            self._queue.remove()
            # Somebody has to take its exit code, whenever it ends.
            Thread(target=self._process.wait, daemon=True).start()
