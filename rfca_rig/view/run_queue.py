"""The run's end of the view: ticks and events go into a queue in shared memory, and the operator's stop request comes back.

It costs the loop microseconds a tick, whatever happens to the view. A view that is slow, stopped or gone leaves a full queue, and what does
not fit is dropped.
"""

import json
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict

from rfca_rig.clock import Clock
from rfca_rig.drivers.roles import StreamHealth
from rfca_rig.engine.interfaces import StopLevel, StopRequest, Tick
from rfca_rig.protocol.check import Load
from rfca_rig.protocol.plan import Stage
from rfca_rig.recording.block_queue import BlockQueue
from rfca_rig.recording.journal import BlockKind, JournalBlock, frame_block
from rfca_rig.view.tick_block import Stamp, tick_block

VITALS_EVERY_S = 0.25
# Events that wait for space in the queue; the limit bounds memory where the view is gone for good.
MAX_WAITING = 500

Vitals = Callable[[], tuple[StreamHealth, int]]
WHY = {StopLevel.SAFE_POINT: "stopped by the operator, in the view", StopLevel.TORQUE_OFF: "stopped at once by the operator, in the view"}


class RunQueue:
    """Implements `engine.observer.RunObserver`.

    `lost` counts force records that the view did not get; the recording has them all. The queue's word for acknowledged stages, which a
    recorder uses, carries the operator's stop request here. `vitals` returns the state of the sensor's stream, and the bytes that the
    recorder is behind. `announce` is called with a line of text when a stop is requested.
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
        self.lost = 0

    def stage(self, stage: Stage, expected: Load | None) -> None:
        load = None if expected is None else [expected.force_N, expected.torque_Nm]
        self._send_event({"about": "stage", "number": self._number(stage), "label": stage.label, "expected": load})
        self._check_stop_request()

    def _number(self, stage: Stage) -> int:
        """Index of a stage in the plan; -1 for one that is not in it, or was passed already."""
        # By identity: a plan may hold equal stages. The search starts after the last one found, because a run only goes forward.
        found = next((place for place in range(self._next, len(self._stages)) if self._stages[place] is stage), -1)
        self._next = max(self._next, found + 1)
        return found

    def energising(self) -> None:
        self._check_stop_request()

    def tick(self, tick: Tick) -> None:
        now_s = self._clock.now_s()
        if now_s - self._vitals_s >= VITALS_EVERY_S:
            self._vitals_s = now_s
            self._send_vitals()
        # Events that still wait come first: a tick after the start of a stage must not be counted to the stage before.
        if not (self._send_waiting() and self._queue.put(frame_block(tick_block(tick, Stamp(now_s, self.lost))))):
            self.lost += len(tick.force.host_s)
        self._check_stop_request()

    def _send_vitals(self) -> None:
        health, backlog_bytes = self._vitals()
        self._send_event({"about": "vitals", "backlog_bytes": backlog_bytes, "health": asdict(health)})

    def line(self, text: str) -> None:
        """A line of text of the run for its operator."""
        self._send_event({"about": "line", "text": text})

    def ended(self, why: str, code: str) -> None:
        """The run is over and the motor is off. `code` is the trip code of the limit that was exceeded, "" for none."""
        self._send_event({"about": "end", "why": why, "code": code})
        self._send_waiting()

    def _send_event(self, event: Mapping[str, object]) -> None:
        self._owed.append(frame_block(JournalBlock(BlockKind.EVENT, json.dumps({**event, "wall_s": self._clock.now_s()}).encode())))
        self._send_waiting()

    def _send_waiting(self) -> bool:
        """Puts waiting events into the queue in order; True where none waits any longer."""
        while self._owed:
            if not self._queue.put(self._owed[0]):
                return False
            self._owed.popleft()
        return True

    def _check_stop_request(self) -> None:
        # The word comes from another process: a larger number is limited to the most urgent stop.
        level = StopLevel(min(self._queue.acknowledged, StopLevel.TORQUE_OFF))
        if level > self._stop_request.level and level in WHY and not self._stop_request.is_over:
            self._stop_request.ask(level, WHY[level])
            self._notify("the view asks for a stop " + ("at the next safe point" if level is StopLevel.SAFE_POINT else "now"))
