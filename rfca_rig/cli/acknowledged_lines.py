"""What a run prints about a stage, held back until the recorder has acknowledged that the stage is on disk."""

from collections import deque

from rfca_rig.bench.recorder import Recorder
from rfca_rig.cli.terminal import Say
from rfca_rig.clock import Clock
from rfca_rig.engine.interfaces import StopLevel, StopRequest
from rfca_rig.recording.backend import SILENT_S, RunBackend

# Half of the time for which the queue takes everything that a 15 kHz sensor sends: what the stop takes still fits.
STOP_S = 10.0


class AcknowledgedLines:
    """A power cut must not cost a stage that was announced, so no line comes before the acknowledgement of its stage.

    A recorder that acknowledges nothing for `SILENT_S` is reported; after `STOP_S` the run stops at the next safe point. Both are looked at
    between stages, because printing may block and the control loop must not.
    """

    def __init__(self, say: Say, keeper: RunBackend, recorder: Recorder, stop_request: StopRequest, clock: Clock) -> None:
        self._say, self._keeper, self._recorder = say, keeper, recorder
        self._stop_request, self._clock = stop_request, clock
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
        silent_s, stages = self._clock.now_s() - since_s, self._recorder.ended - number + 1
        if silent_s > SILENT_S and not self._is_silent:
            self._is_silent = True
            self._say(f"the disk is silent: {stages} stage{'s' * (stages > 1)} done, not on disk since {silent_s:.0f} s")
        if silent_s > STOP_S:
            self._stop_request.ask(StopLevel.SAFE_POINT, f"the disk has acknowledged nothing for {silent_s:.0f} s")

    def close(self) -> None:
        """Print what is acknowledged once the recorder has ended, and count what is not."""
        self._print_acknowledged()
        if self._waiting:
            self._say(f"{self._recorder.ended - self._waiting[0][0] + 1} stages were done and are not on disk: the recorder failed")
            self._waiting.clear()

    def _print_acknowledged(self) -> None:
        while self._waiting and self._waiting[0][0] <= self._keeper.acknowledged:
            self._say(self._waiting.popleft()[2])
