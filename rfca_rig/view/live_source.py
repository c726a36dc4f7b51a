"""A run that goes on, at the view's end: takes what the queue hands over, and says it as the page takes it."""

import json
from collections import deque
from collections.abc import Sequence
from dataclasses import asdict
from itertools import groupby
from typing import Any

import numpy as np

from rfca_rig.clock import Clock
from rfca_rig.engine.stop_request import StopLevel
from rfca_rig.protocol.check import Load
from rfca_rig.recording.block_queue import BlockQueue
from rfca_rig.recording.journal import BlockKind, JournalBlock, whole_blocks
from rfca_rig.view.gauges import Gauges
from rfca_rig.view.leg_pose import LegMoment, Legs
from rfca_rig.view.live_health import LiveHealth
from rfca_rig.view.messages import CHANNELS, WRENCH, Message, hanging_deg, hello
from rfca_rig.view.progress import Progress
from rfca_rig.view.pyramid import Pyramid
from rfca_rig.view.run_facts import RunFacts
from rfca_rig.view.scenes import NOWHERE
from rfca_rig.view.stream_clock import StreamClock
from rfca_rig.view.tick_block import SeenTicks, ticks_of

WAITS_S = 0.1  # for the slower of the two streams
SILENT_S = 0.25  # longer than a loop is late on a busy machine: what came after a bucket was closed is drawn too far to the right
FLUSH_S = 0.008
LINES = 12
STOP_LEVELS = {"safe point": StopLevel.SAFE_POINT, "now": StopLevel.TORQUE_OFF}
DONE = "done"
SILENT_END = "the run's process ended without a word"
FORCE, SHAFT = slice(0, len(WRENCH)), slice(len(WRENCH), len(CHANNELS))


class LiveSource:
    """`look` takes everything that came; afterwards `pyramid`, `state` and `leg` are up to date."""

    def __init__(self, facts: RunFacts, queue: BlockQueue, clock: Clock, legs: Legs) -> None:
        """`clock` is that of the run's queue."""
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
        self._target_rad = 0.0
        self._force_N: tuple[float, float] | None = None
        self._scene, self._label = NOWHERE, "not begun"
        self._said: deque[str] = deque(maxlen=LINES)
        self._ended: str | None = None
        self._code = ""
        self._asked: str | None = None
        self.pyramid = Pyramid(len(CHANNELS))

    @property
    def now_s(self) -> float:
        """Rig time since the run began, as far as it was heard of."""
        return self._now_s

    @property
    def is_over(self) -> bool:
        return self._ended is not None

    def hello(self) -> Message:
        facts = self._facts
        return hello(facts.title, facts.mark, facts.stages, self._gauges.listed(), self._legs.described)

    def stop(self, how: str) -> bool:
        """Asks the run for a stop; False where there is nothing to stop any more. Raises LookupError for an unknown way to."""
        level = STOP_LEVELS[how]
        if self.is_over:
            return False
        if level > self._queue.acknowledged:
            self._queue.tell(level, False)
            self._asked = how
        return True

    def look(self) -> None:
        """Never waits."""
        blocks, length = whole_blocks(self._queue.look())
        self._queue.took(length)
        oldest_s = [self._take(kind, list(some)) for kind, some in groupby(blocks, key=lambda block: block.kind)]
        wall_s = self._clock.now_s()
        is_silent = self._began_s is not None and wall_s - self._ticked_s > SILENT_S
        self.pyramid.close_before(self._all_s() if is_silent else max(min(self._newest), self._now_s - WAITS_S))
        self._health.delay(wall_s, min(oldest_s, default=np.inf))

    def _all_s(self) -> float:
        """Behind everything that came: what a loop that ticks no more has seen last is not held back."""
        return (max(*self._newest, self._now_s) // FLUSH_S + 1) * FLUSH_S

    def gone(self) -> None:
        """The run's process is no more."""
        self.look()
        if not self.is_over:
            self._end(SILENT_END, "", self._clock.now_s())

    def _take(self, kind: BlockKind, blocks: Sequence[JournalBlock]) -> float:
        """Blocks of one kind in a row; returns when the first of them was handed over, for ticks."""
        if kind is BlockKind.SAMPLES:
            ticks = ticks_of(blocks)
            self._samples(ticks)
            return float(ticks.wall_s[0])
        for block in blocks:
            self._word(json.loads(block.payload))
        return np.inf

    def _word(self, said: dict[str, Any]) -> None:
        match said["about"]:
            case "stage":
                self._stage(said)
            case "vitals":
                self._health.vitals(said)
            case "line":
                self._said.append(said["text"])
            case "end":
                self._end(said["why"], said["code"], said["wall_s"])

    def _stage(self, said: dict[str, Any]) -> None:
        number = said["number"]
        self._progress.begin(number, said["wall_s"])
        self._gauges.stage(None if said["expected"] is None else Load(*said["expected"]))
        self._label = said["label"]
        if number >= 0:
            self._scene = self._facts.scenes[number]

    def _end(self, why: str, code: str, wall_s: float) -> None:
        self._ended, self._code, self._label = why, code, "over"
        self._progress.end(wall_s, is_whole=why == DONE)
        self.pyramid.close_before(self._all_s())

    def _samples(self, ticks: SeenTicks) -> None:
        self._target_rad = float(ticks.target_rad[-1])
        self._began_s = float(ticks.now_s[0]) if self._began_s is None else self._began_s
        self._now_s, self._ticked_s = float(ticks.now_s[-1]) - self._began_s, float(ticks.wall_s[-1])
        self._gauges.take(ticks)
        self._health.take(ticks)
        if ticks.shaft.shape[1]:
            host_s, device_s, angle_rad, speed_rad_s, _ = ticks.shaft
            self._shaft_rad = float(angle_rad[-1])
            self._put(0, host_s, device_s, np.column_stack([hanging_deg(angle_rad), speed_rad_s]), SHAFT)
        if len(ticks.counts):
            wrench = ticks.counts / self._per_unit
            self._force_N = float(wrench[-1, 1]), float(wrench[-1, 2])
            self._put(1, ticks.force_host_s, ticks.force_device_s, wrench, FORCE)

    def _put(self, stream: int, host_s: np.ndarray, device_s: np.ndarray, values: np.ndarray, channels: slice) -> None:
        t_s = self._clocks[stream].run_s(host_s, device_s) - (self._began_s or 0.0)
        self._newest[stream] = max(self._newest[stream], float(t_s[-1]))
        self.pyramid.take(t_s, values, channels)

    def state(self) -> Message:
        """Limits tell what was nearest since this was last asked for."""
        at = self._progress.at(self._clock.now_s())
        return {
            "kind": "state",
            "now_s": round(self._now_s, 4),
            "stage": at.stage,
            "stage_label": self._label,
            "stage_done": at.stage_done,
            "done": at.done,
            "eta_s": at.eta_s,
            "limits": self._gauges.told(),
            "health": [asdict(line) for line in self._health.told()],
            "said": list(self._said),
            "speed": 1.0,
            "stop_asked": self._asked,
            "ended": self._ended,
            "trip": {"code": self._code, "text": self._ended} if self._code else None,
        }

    def leg(self) -> Message | None:
        """None where nothing is known yet."""
        if self._shaft_rad is None:
            return None
        return self._legs.message(LegMoment(self._scene, self._shaft_rad, self._target_rad, force_N=self._force_N))
