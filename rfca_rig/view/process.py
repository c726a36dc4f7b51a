"""The process that serves the live view of a run. The control loop never waits for it and does not
need it.

It reads the run's queue, builds messages, and feeds each page at the resolution that it shows. It
outlives the run for as long as a page is open, so that the operator sees how the run ended. It
stays a while longer for a page that is opened late or loaded again.
"""

import asyncio
import json
import os
import signal
import socket
import sys
import threading
from collections import deque
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from itertools import groupby
from math import ceil
from multiprocessing.connection import Connection
from typing import Any

import numpy as np

from rfca_rig.clock import Clock, WallClock
from rfca_rig.engine.interfaces import StopLevel
from rfca_rig.errors import RigError
from rfca_rig.protocol.check import Load
from rfca_rig.protocol.plan import TURN_RAD, turns_between
from rfca_rig.recording.block_queue import BlockQueue
from rfca_rig.recording.journal import BlockKind, JournalBlock, parse_blocks
from rfca_rig.view.expected_force import ExpectedFeed, ExpectedForces, PlacedStroke
from rfca_rig.view.gauges import Gauges, LiveHealth, StreamClock
from rfca_rig.view.leg_pose import LegMoment, Legs
from rfca_rig.view.messages import (
    BEATS_HZ,
    CHANNELS,
    SHORTEST_SPAN_S,
    SPAN_S,
    STATES_HZ,
    WRENCH,
    Feed,
    Message,
    hello,
    number_in,
    trace,
)
from rfca_rig.view.pyramid import Extrema, Pyramid, level_for, width_s
from rfca_rig.view.run_facts import FAILED, READY, UNKNOWN_SCENE, Progress, RunFacts, ViewAssignment
from rfca_rig.view.run_queue import SeenTicks, ticks_of
from rfca_rig.view.server import DEBUG_VARIABLE, Pages, listen_on, port_of, serve

# Buckets stay open this long for the slower of the two streams.
MAX_WAIT_S = 0.1
# Without ticks for this long, all buckets are closed. Longer than a loop is late on a busy machine:
# a sample that comes after its bucket was closed is drawn too far to the right.
SILENT_S = 0.25
# Buckets are closed up to a multiple of this, 16 buckets of the finest level.
FLUSH_S = 0.008
# Of the run's messages to the operator, the last ones are shown.
LINES = 12
# Strokes whose expected force is kept. The longest window of a page, two minutes, has fewer.
MOST_STROKES = 300
# The words that a page sends.
STOP_LEVELS = {"safe point": StopLevel.SAFE_POINT, "now": StopLevel.TORQUE_OFF}
# Words of a state.
PAUSE_ASKED = "asked"
PAUSED = "paused"
DONE = "done"
SILENT_END = "the run's process ended without a word"
FORCE = slice(0, len(WRENCH))
SHAFT = slice(len(WRENCH), len(CHANNELS))
SHAFT_ANGLE = SHAFT.start
HALF_TURN_RAD = 0.5 * TURN_RAD

LONGEST_SPAN_S = 7 * 86400.0
STATE_EVERY = round(BEATS_HZ / STATES_HZ)


class LiveSource:
    """State of a run as received so far. `look` reads the queue; afterwards `pyramid`, `state`
    and `leg` are up to date.
    """

    def __init__(self, facts: RunFacts, queue: BlockQueue, clock: Clock, legs: Legs) -> None:
        """`clock` is the one that the run's queue stamps its ticks with."""
        self._facts = facts
        self._queue = queue
        self._clock = clock
        self._legs = legs
        self._gauges = Gauges(facts.limits, facts.scale)
        self._progress = Progress(facts.stages)
        self._health = LiveHealth(facts.limits, facts.scale)
        self._per_unit = np.repeat([facts.scale.counts_per_N, facts.scale.counts_per_Nm], 3)
        self._clocks = StreamClock(), StreamClock()
        self._newest = [0.0, 0.0]
        self._began_s: float | None = None
        self._now_s = self._ticked_s = 0.0
        self._shaft_rad: float | None = None
        self._turns_rad: float | None = None
        self._stage_number = -1
        self._is_cycling = False
        self._target_rad = 0.0
        self._force_N: tuple[float, float] | None = None
        self._scene = UNKNOWN_SCENE
        self._stage_label = "not begun"
        self._lines: deque[str] = deque(maxlen=LINES)
        self._ended: str | None = None
        self._code = ""
        self._asked: str | None = None
        self._is_paused = False
        self.pyramid = Pyramid(len(CHANNELS))
        self.forces = ExpectedForces(facts.nominal, facts.known_to)
        # Replaced, never changed, with each stroke: pages compare it by identity.
        self.strokes: tuple[PlacedStroke, ...] = ()

    def prepare(self) -> None:
        """Computes the shapes of the leg and the forces of all strokes, which takes seconds."""
        self._legs.prepare(self._facts.scenes)
        self.forces.prepare(self._facts.strokes)

    @property
    def now_s(self) -> float:
        """Rig time in s since the run began, of the newest tick received."""
        return self._now_s

    @property
    def is_over(self) -> bool:
        return self._ended is not None

    def hello(self) -> Message:
        facts = self._facts
        return hello(
            facts.title, facts.mark, facts.stages, self._gauges.describe(), self._legs.description
        )

    def stop(self, how: str) -> bool:
        """Requests a stop of the run; False where the run is over. Raises LookupError for an
        unknown kind of stop.
        """
        level = STOP_LEVELS[how]
        if self.is_over:
            return False
        # A request is only ever replaced by a more urgent one. It travels in the queue's word for
        # acknowledged stages.
        if level > self._queue.acknowledged:
            self._queue.tell(level, self._queue.has_complained)
            self._asked = how
        return True

    def pause(self, is_wanted: bool) -> bool:
        """Requests a pause of the run, or that it goes on; False where the run is over, is to be
        stopped, or is asked for that already.
        """
        level = self._queue.acknowledged
        if self.is_over or level or is_wanted == self._queue.has_complained:
            return False
        # The queue's word for a complaint.
        self._queue.tell(level, is_wanted)
        return True

    def look(self) -> None:
        """Reads everything in the queue. Never waits."""
        blocks, length = parse_blocks(self._queue.look())
        # Only whole blocks are released.
        self._queue.consume(length)
        # Consecutive ticks are decoded together, which is much faster than one by one; events keep
        # their place between them.
        oldest_s = [
            self._take(kind, list(some))
            for kind, some in groupby(blocks, key=lambda block: block.kind)
        ]
        wall_s = self._clock.now_s()
        is_silent = self._began_s is not None and wall_s - self._ticked_s > SILENT_S
        if is_silent:
            closed_s = self._end_of_data_s()
        else:
            closed_s = max(min(self._newest), self._now_s - MAX_WAIT_S)
        self.pyramid.close_before(closed_s)
        self._health.delay(wall_s, min(oldest_s, default=np.inf))

    def _end_of_data_s(self) -> float:
        """Time in s after all received samples: when the loop has stopped, its last samples must
        still be drawn.
        """
        return (max(*self._newest, self._now_s) // FLUSH_S + 1) * FLUSH_S

    def on_run_exit(self) -> None:
        """The run's process has ended."""
        # What it put into the queue before its end is still there, perhaps with the reason.
        self.look()
        if not self.is_over:
            self._end(SILENT_END, "", self._clock.now_s())

    def _take(self, kind: BlockKind, blocks: Sequence[JournalBlock]) -> float:
        """Takes in consecutive blocks of one kind. Returns when the first tick was put into the
        queue, infinity for events.
        """
        if kind is BlockKind.SAMPLES:
            ticks = ticks_of(blocks)
            self._samples(ticks)
            return float(ticks.wall_s[0])
        for block in blocks:
            event = json.loads(block.payload)
            match event["about"]:
                case "stage":
                    self._stage(event)
                case "start":
                    self._start(event["start_s"])
                case "pause":
                    self._is_paused = event["is_paused"]
                    self._progress.pause(self._is_paused, event["wall_s"])
                case "vitals":
                    self._health.vitals(event)
                case "line":
                    self._lines.append(event["text"])
                case "end":
                    self._end(event["why"], event["code"], event["wall_s"])
        return np.inf

    def _stage(self, event: dict[str, Any]) -> None:
        number = event["number"]
        self._stage_number = number
        self._progress.begin(number, event["wall_s"])
        expected = None
        if event["expected"] is not None:
            expected = Load(*event["expected"])
        self._gauges.stage(expected)
        self._stage_label = event["label"]
        if event["turns_rad"] is not None:
            self._turns_rad = event["turns_rad"]
        self._is_cycling = number >= 0 and self._facts.stages[number].kind == "cycles"
        if number >= 0:
            self._scene = self._facts.scenes[number]

    def _start(self, start_s: float) -> None:
        """The commanded motion of the present stage begins."""
        # The page's time begins with the first tick that the view has got.
        if self._stage_number < 0 or self._began_s is None:
            return
        stroke = self._facts.strokes[self._stage_number]
        if stroke is None:
            return
        from_s = start_s - self._began_s
        placed = PlacedStroke(from_s, from_s + stroke.duration_s, stroke.condition)
        self.strokes = (*self.strokes[1 - MOST_STROKES :], placed)

    def _end(self, why: str, code: str, wall_s: float) -> None:
        self._ended = why
        self._code = code
        self._stage_label = "over"
        self._progress.end(wall_s, is_whole=why == DONE)
        self.pyramid.close_before(self._end_of_data_s())

    def _samples(self, ticks: SeenTicks) -> None:
        self._target_rad = float(ticks.target_rad[-1])
        # The page's time starts with the first tick, not with the rig's clock.
        if self._began_s is None:
            self._began_s = float(ticks.now_s[0])
        self._now_s = float(ticks.now_s[-1]) - self._began_s
        self._ticked_s = float(ticks.wall_s[-1])
        self._gauges.take(ticks)
        self._health.take(ticks)
        if ticks.shaft.shape[1]:
            host_s, device_s, angle_rad, speed_rad_s, _ = ticks.shaft
            self._shaft_rad = float(angle_rad[-1])
            # A drive may report any number of turns before the first stage that has an angle.
            if self._turns_rad is None:
                self._turns_rad = turns_between(0.0, float(angle_rad[0]))
            # Thousands of turns make a stage of cycles. Each counts from 0 to 360 degrees, so that
            # the number says where the leg is.
            if self._is_cycling:
                self._turns_rad = turns_between(HALF_TURN_RAD, self._shaft_rad)
            self._add_to_pyramid(
                0, host_s, device_s, np.column_stack([np.degrees(angle_rad), speed_rad_s]), SHAFT
            )
        if len(ticks.counts):
            wrench = ticks.counts / self._per_unit
            self._force_N = float(wrench[-1, 1]), float(wrench[-1, 2])
            self._add_to_pyramid(1, ticks.force_host_s, ticks.force_device_s, wrench, FORCE)

    def _add_to_pyramid(
        self,
        stream: int,
        host_s: np.ndarray,
        device_s: np.ndarray,
        values: np.ndarray,
        channels: slice,
    ) -> None:
        t_s = self._clocks[stream].run_s(host_s, device_s) - (self._began_s or 0.0)
        self._newest[stream] = max(self._newest[stream], float(t_s[-1]))
        self.pyramid.take(t_s, values, channels)

    @property
    def turns_rad(self) -> float:
        """Whole turns in rad that the shaft's continuous angle is ahead of the stage's angles."""
        return self._turns_rad or 0.0

    def extrema(self, level: int, begin: int, end: int) -> Extrema:
        """Extrema (end - begin, channels) of closed buckets for the page. The shaft's angle counts
        as in the recording of the present stage, or in the present cycle. It is continuous over all
        buckets.
        """
        extrema = self.pyramid.between(level, begin, end)
        turns_deg = np.degrees(self.turns_rad)
        extrema.low[:, SHAFT_ANGLE] -= turns_deg
        extrema.high[:, SHAFT_ANGLE] -= turns_deg
        return extrema

    def state(self) -> Message:
        """State for the page. Each limit shows the value that came nearest to it since the last
        call.
        """
        at = self._progress.at(self._clock.now_s())
        trip = None
        if self._code:
            trip = {"code": self._code, "text": self._ended}
        return {
            "kind": "state",
            "now_s": round(self._now_s, 4),
            "stage": at.stage,
            "stage_label": self._stage_label,
            "stage_done": at.stage_done,
            "done": at.done,
            "eta_s": at.eta_s,
            "limits": self._gauges.read_values(),
            "health": [asdict(line) for line in self._health.list_lines()],
            "said": list(self._lines),
            "speed": 1.0,
            "stop_asked": self._asked,
            "pause": self._pause_word(),
            "ended": self._ended,
            "trip": trip,
        }

    def _pause_word(self) -> str | None:
        """Of a run that waits, or will wait as soon as the leg is in the air; None otherwise."""
        if self.is_over:
            return None
        if self._is_paused:
            return PAUSED
        if self._queue.has_complained:
            return PAUSE_ASKED
        return None

    def leg(self) -> Message | None:
        """Pose of the leg for the page; None before the first angle of the shaft."""
        if self._shaft_rad is None:
            return None
        return self._legs.message(
            LegMoment(self._scene, self._shaft_rad, self._target_rad, force_N=self._force_N)
        )


class LiveRun:
    """Implements `messages.FeedSource`. `beat` reads the queue once for all pages."""

    def __init__(self, source: LiveSource) -> None:
        self.source = source
        self._beats = 0
        self.state = source.state()
        self.leg = source.leg()

    def beat(self) -> None:
        self.source.look()
        self._refresh()

    def on_run_exit(self) -> None:
        """The run's process has ended."""
        self.source.on_run_exit()
        # Zero makes the next refresh build a state at once, so that every page shows the end.
        self._beats = 0
        self._refresh()

    def _refresh(self) -> None:
        if self._beats % STATE_EVERY == 0:
            self.state = self.source.state()
        self._beats += 1
        self.leg = self.source.leg()

    def hello(self) -> Message:
        return self.source.hello()

    def feed(self) -> Feed:
        return LiveFeed(self)

    def stop(self, how: str) -> bool:
        return self.source.stop(how)

    def pause(self, is_wanted: bool) -> bool:
        return self.source.pause(is_wanted)


class LiveFeed:
    """Implements `messages.Feed`."""

    def __init__(self, run: LiveRun) -> None:
        self._run = run
        self._shown: tuple[Message | None, Message | None] = (None, None)
        self._expected = ExpectedFeed(run.source.forces)
        self._span_s = SPAN_S
        self._begin()

    def _begin(self) -> None:
        # Another span needs another level of the pyramid; the page gets the whole window again.
        self._level = level_for(self._span_s)
        self._sent: int | None = None
        self._turns_rad = self._run.source.turns_rad

    def handle_message(self, message: Mapping[str, Any]) -> None:
        if message.get("kind") == "span":
            span_s = number_in(message, "span_s")
        else:
            span_s = None
        if span_s is not None:
            self._span_s = min(max(span_s, SHORTEST_SPAN_S), LONGEST_SPAN_S)
            self._begin()

    def new_messages(self) -> Sequence[Message]:
        shown = self._shown
        self._shown = (self._run.state, self._run.leg)
        # States and legs are shared by all pages: identity tells whether this page has had the
        # current one.
        changed = [
            now
            for before, now in zip(shown, self._shown, strict=True)
            if now is not None and now is not before
        ]
        traced = self._trace()
        expected = self._expected.new_messages(self._run.source.strokes)
        if traced is None:
            return [*expected, *changed]
        return [traced, *expected, *changed]

    def _trace(self) -> Message | None:
        source = self._run.source
        # Another stage may count its angles from another turn; the page gets the whole window again
        # with those.
        if source.turns_rad != self._turns_rad:
            self._begin()
        pyramid = source.pyramid
        end = pyramid.count_closed(self._level)
        # A page that fell behind the oldest bucket kept cannot be continued without a gap: its
        # window starts again.
        begin = self._sent
        if begin is None or begin < pyramid.oldest(self._level):
            is_reset = True
            begin = max(end - ceil(self._span_s / width_s(self._level)), 0)
        else:
            is_reset = False
        if begin >= end:
            return None
        self._sent = end
        return trace(width_s(self._level), begin, source.extrema(self._level, begin, end), is_reset)


# Lower priority than the control loop's process.
NICE = 5
# After the run: how long the view waits for a page, and how long it lasts at most, so that a
# forgotten page keeps no process for ever.
MAX_IDLE_S = 60.0
LONGEST_S = 12 * 3600.0


def show(parent: Connection) -> None:
    """Receives its assignment from the parent, answers (READY, port) or (FAILED, why), and
    serves the run until a while after its end.
    """
    # ^C in the terminal is for the run, which may need its view to the end.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    _lower_priority()
    assignment: ViewAssignment = parent.recv()
    try:
        listening = listen_on(assignment.port)
        queue = BlockQueue.attach(assignment.queue_name)
    except RigError as error:
        parent.send((FAILED, str(error)))
        return
    parent.send((READY, port_of(listening)))
    source = LiveSource(assignment.facts, queue, assignment.clock, Legs(assignment.facts.nominal))
    # Until the shapes are there the page shows a straight leg, and no expected force.
    threading.Thread(target=source.prepare, daemon=True).start()
    run = LiveRun(source)
    try:
        asyncio.run(_serve(run, assignment, parent, listening))
    finally:
        queue.close()


def _lower_priority() -> None:
    """Lowers the priority below the control loop's, and sends output to the null device, because
    the run's terminal may be gone.

    Must come first: Python's tracker of shared memory is a process of its own, which keeps the
    streams that it inherits.
    """
    os.nice(NICE)
    if os.environ.get(DEBUG_VARIABLE):
        return
    nowhere = os.open(os.devnull, os.O_WRONLY)
    for stream in (sys.stdout, sys.stderr):
        stream.flush()
        os.dup2(nowhere, stream.fileno())


async def _serve(
    run: LiveRun, assignment: ViewAssignment, parent: Connection, listening: socket.socket
) -> None:
    patience = LingerPolicy(assignment.clock)
    loop = asyncio.get_running_loop()

    def on_parent_exit() -> None:
        loop.remove_reader(parent.fileno())
        run.on_run_exit()
        patience.run_is_over()

    def beat(pages: Pages) -> bool:
        run.beat()
        return patience.goes_on(pages.open)

    # The parent's socket becomes readable when the parent closes it or dies: no polling is needed.
    loop.add_reader(parent.fileno(), on_parent_exit)
    await serve(run, assignment.token, listening, asyncio.Event(), beat)


class LingerPolicy:
    """Decides how long a view stays after its run."""

    def __init__(self, clock: WallClock) -> None:
        self._clock = clock
        self._over_s: float | None = None
        self._last_seen_s = clock.now_s()

    def run_is_over(self) -> None:
        self._over_s = self._last_seen_s = self._clock.now_s()

    def goes_on(self, open_pages: int) -> bool:
        """Whether to keep serving; called at every beat."""
        if self._over_s is None:
            return True
        now_s = self._clock.now_s()
        if open_pages:
            self._last_seen_s = now_s
        return now_s - self._last_seen_s < MAX_IDLE_S and now_s - self._over_s < LONGEST_S


if __name__ == "__main__":
    with Connection(int(sys.argv[1])) as parent:
        show(parent)
