"""The process that owns a run's files, and does nothing but bring to disk what the control loop hands over.

A process and not a thread: compressing a stroke holds the interpreter, in which the control loop stands still while the drive's watchdog
runs. Measured at 500 Hz with 7000 records/s, worst gap between commands beyond the ticks of 10 ms: written by the loop itself 254 ms, by
a thread 18 ms, by this process 0.6 ms (python -m tests.benchmarks.recording).
"""

import signal
import subprocess
import sys
from collections.abc import Callable
from dataclasses import dataclass
from multiprocessing.connection import Connection
from pathlib import Path

from rfca_rig import subprocesses
from rfca_rig.clock import Clock, WallClock
from rfca_rig.errors import RigError
from rfca_rig.recording.block_queue import BlockQueue
from rfca_rig.recording.blocks import End
from rfca_rig.recording.journal import BlockKind, JournalBlock, whole_blocks
from rfca_rig.recording.photo_sender import AnnouncedPhoto
from rfca_rig.recording.run_writer import RunWriter

MODULE = "rfca_rig.recording.recorder_process"
PAUSE_S = 0.005
FORCED_EVERY_S = 0.4  # with what is under way, a power cut costs half a second
READY, COMPLAINT, DONE = "ready", "complaint", "done"
CONTROL_GONE = "the control process ended"


@dataclass(frozen=True)
class RecorderAssignment:
    """Which run to keep, and where its blocks come from.

    With `patient` each stage is brought to disk before anything else is taken, so that the order of events is the same every time.
    """

    folder: Path
    queue_name: str
    patient: bool


def started(assignment: RecorderAssignment) -> tuple[subprocess.Popen[bytes], Connection]:
    """The process at work, and the way to talk to it."""
    return subprocesses.started(MODULE, assignment)


def keep(parent: Connection) -> None:
    """Takes its assignment from the parent, says READY or why not, and keeps the run until the parent says why it ends.

    What it says are pairs: of COMPLAINT, at most once, and what ends the run; at last of DONE and what could not be kept, "" for
    nothing. A parent that is gone ends the run too, with all that it had handed over.
    """
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    assignment: RecorderAssignment = parent.recv()
    try:
        queue, writer = BlockQueue.attach(assignment.queue_name), RunWriter(assignment.folder)
    except RigError as error:
        _say(parent, DONE, str(error))
        return
    _say(parent, READY, "")
    recorder = DiskRecorder(queue, writer, WallClock(), parent, assignment.patient)
    _say(parent, DONE, recorder.close(recorder.run()))
    queue.close()


def _say(parent: Connection, what: str, words: str) -> None:
    try:
        parent.send((what, words))
    except OSError:
        return  # a parent that is gone hears nothing


class DiskRecorder:
    """From the queue to the disk. What the disk refuses for good is told once, and the rest is let go by."""

    def __init__(self, queue: BlockQueue, writer: RunWriter, clock: Clock, parent: Connection, patient: bool) -> None:
        self._queue = queue
        self._writer = writer
        self._clock = clock
        self._parent = parent
        self._patient = patient
        self._pictures: set[str] = set()
        self._why: str | None = None
        self._fault = ""
        self._complained = False

    def run(self) -> str:
        """Until the parent has no more to say; returns why the run ends."""
        forced_s, is_busy = self._clock.now_s(), False
        while True:
            self._listen(0.0 if is_busy else PAUSE_S)
            self._drain()
            is_busy = self._guarded(self._writer.work)
            if self._clock.now_s() - forced_s > FORCED_EVERY_S:
                self._guarded(self._writer.force)
                forced_s = self._clock.now_s()
            self._tell()
            if self._why is not None:
                return self._why

    def close(self, why: str) -> str:
        """Takes what still waits, ends the run's files, and returns what went wrong, "" for nothing."""
        self._drain()
        try:
            self._writer.close(why)
        except (RigError, OSError) as error:
            self._fault = self._fault or str(error)
        self._queue.tell(self._writer.acknowledged, bool(self._fault))
        return self._fault

    def _listen(self, wait_s: float | None) -> None:
        """Takes a photo, or why the run ends, if there is either."""
        try:
            if self._parent.poll(wait_s):
                said = self._parent.recv()
                if isinstance(said, AnnouncedPhoto):
                    picture = said.received(self._parent)
                    self._guarded(lambda: self._writer.keep_picture(said.name, picture))
                    self._pictures.add(said.name)
                else:
                    self._why = str(said)
        except (EOFError, OSError):
            self._why = CONTROL_GONE

    def _drain(self) -> None:
        blocks, length = whole_blocks(self._queue.look())
        self._guarded(lambda: self._take(blocks))
        self._queue.took(length)
        self._tell()

    def _take(self, blocks: list[JournalBlock]) -> None:
        for block in blocks:
            if block.kind is BlockKind.END:
                self._await_photo(End.of(block))
            self._writer.take(block)
            if self._patient:
                self._writer.work_off()
        self._writer.flush()

    def _await_photo(self, end: End) -> None:
        """It is sent before its stage ends, by another way."""
        while end.static and end.static.photo and end.static.photo not in self._pictures and self._why is None:
            self._listen(None)

    def _guarded(self, work: Callable[[], object]) -> bool:
        """Whether it said that there is more to do; after a fault nothing is done any more."""
        if self._fault:
            return False
        try:
            return bool(work())
        except (RigError, OSError) as error:
            self._fault = self._writer.complaint or str(error)
            return False

    def _tell(self) -> None:
        said = self._writer.complaint or self._fault
        if said and not self._complained:
            self._complained = True
            _say(self._parent, COMPLAINT, said)
        self._queue.tell(self._writer.acknowledged, self._complained)


if __name__ == "__main__":
    with Connection(int(sys.argv[1])) as parent:
        keep(parent)
