"""The run's end of the view: what the loop saw goes into a queue that drops what does not fit, and the operator's stop request comes back.

Costs the loop microseconds a tick, whatever becomes of the view: one that is slow, stopped or gone leaves a queue that is full.
"""

import json
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict

from rfca_rig.clock import Clock
from rfca_rig.drivers.roles import StreamHealth
from rfca_rig.engine.observer import Tick
from rfca_rig.engine.stop_request import StopLevel, StopRequest
from rfca_rig.protocol.check import Load
from rfca_rig.protocol.plan import Stage
from rfca_rig.recording.block_queue import BlockQueue
from rfca_rig.recording.journal import BlockKind, JournalBlock, framed
from rfca_rig.view.tick_block import Stamp, tick_block

VITALS_EVERY_S = 0.25
MOST_OWED = 500  # words that wait for room; with a view that is gone for good they are not gathered without end

Vitals = Callable[[], tuple[StreamHealth, int]]
WHY = {StopLevel.SAFE_POINT: "stopped by the operator, in the view", StopLevel.TORQUE_OFF: "stopped at once by the operator, in the view"}


class RunQueue:
    """Implements `engine.observer.RunObserver`. `lost` counts the force records that the view did not get, which every recording has.

    What the queue acknowledges, for a recorder its stages, is the operator's stop request here. `vitals` gives the state of the sensor's
    stream, and the bytes that the recorder is behind; `told` is called with a line as soon as a stop was asked for.
    """

    def __init__(
        self,
        queue: BlockQueue,
        stages: Sequence[Stage],
        stop_request: StopRequest,
        clock: Clock,
        vitals: Vitals,
        told: Callable[[str], None],
    ) -> None:
        """`clock` is the one that the view's process has, too."""
        self._queue = queue
        self._stages = stages
        self._stop_request = stop_request
        self._clock = clock
        self._vitals = vitals
        self._told = told
        self._next = 0
        self._vitals_s = -VITALS_EVERY_S
        self._owed: deque[bytes] = deque(maxlen=MOST_OWED)
        self.lost = 0

    def stage(self, stage: Stage, expected: Load | None) -> None:
        load = None if expected is None else [expected.force_N, expected.torque_Nm]
        self._say({"about": "stage", "number": self._number(stage), "label": stage.label, "expected": load})
        self._hear()

    def _number(self, stage: Stage) -> int:
        """Its place in the plan; -1 for one that is not there, or was left behind."""
        found = next((place for place in range(self._next, len(self._stages)) if self._stages[place] is stage), -1)
        self._next = max(self._next, found + 1)
        return found

    def energising(self) -> None:
        self._hear()

    def tick(self, tick: Tick) -> None:
        now_s = self._clock.now_s()
        if now_s - self._vitals_s >= VITALS_EVERY_S:
            self._vitals_s = now_s
            self._tell_vitals()
        if not (self._settle() and self._queue.put(framed(tick_block(tick, Stamp(now_s, self.lost))))):
            self.lost += len(tick.force.host_s)
        self._hear()

    def _tell_vitals(self) -> None:
        health, backlog_bytes = self._vitals()
        self._say({"about": "vitals", "backlog_bytes": backlog_bytes, "health": asdict(health)})

    def line(self, text: str) -> None:
        """What the run says to its operator."""
        self._say({"about": "line", "text": text})

    def ended(self, why: str, code: str) -> None:
        """The motor is off. `code` is that of the limit which was passed, "" for none."""
        self._say({"about": "end", "why": why, "code": code})
        self._settle()

    def _say(self, word: Mapping[str, object]) -> None:
        self._owed.append(framed(JournalBlock(BlockKind.EVENT, json.dumps({**word, "wall_s": self._clock.now_s()}).encode())))
        self._settle()

    def _settle(self) -> bool:
        """Words keep their order, and come before the ticks after them; True when none waits any longer."""
        while self._owed:
            if not self._queue.put(self._owed[0]):
                return False
            self._owed.popleft()
        return True

    def _hear(self) -> None:
        level = StopLevel(min(self._queue.acknowledged, StopLevel.TORQUE_OFF))
        if level > self._stop_request.level and level in WHY and not self._stop_request.is_over:
            self._stop_request.ask(level, WHY[level])
            self._told("the view asks for a stop " + ("at the next safe point" if level is StopLevel.SAFE_POINT else "now"))
