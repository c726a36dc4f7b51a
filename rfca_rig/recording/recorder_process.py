"""The process that owns a run's files and writes to disk what the control loop hands over.

A process and not a thread: compressing a stroke holds the interpreter, and the control loop stands
still while the drive's watchdog runs. Measured at 500 Hz with 7000 records/s, worst gap between
commands beyond the ticks of 10 ms: written by the loop itself 254 ms, by a thread 18 ms, by this
process 0.6 ms (python -m tests.benchmarks.recording).
"""

import atexit
import gc
import signal
import sys
from collections.abc import Callable
from dataclasses import dataclass
from multiprocessing.connection import Connection
from pathlib import Path

from rfca_rig.clock import Clock, WallClock
from rfca_rig.errors import RigError
from rfca_rig.recording.block_queue import BlockQueue
from rfca_rig.recording.journal import BlockKind, End, JournalBlock, parse_blocks
from rfca_rig.recording.run_writer import AnnouncedPhoto, RunWriter
from rfca_rig.subprocesses import Helper, start

MODULE = "rfca_rig.recording.recorder_process"
# Seconds to wait for a message while there is nothing else to do.
PAUSE_S = 0.005
# Together with what is under way, a power cut costs half a second at most.
FORCED_EVERY_S = 0.4
READY = "ready"
COMPLAINT = "complaint"
DONE = "done"
CONTROL_GONE = "the control process ended"


@dataclass(frozen=True)
class RecorderAssignment:
    """Which run to record, and the queue that its blocks come from.

    With `patient` each stage is on disk before the next block is taken, so that the order of events
    is the same every time.
    """

    folder: Path
    queue_name: str
    patient: bool


def start_recorder() -> Helper:
    """Starts the process, which waits for its `RecorderAssignment`, and ends where the
    connection is closed without one.
    """
    return start(MODULE)


def record_run(parent: Connection) -> None:
    """Receives its assignment from the parent, answers READY or the error, and records the run
    until the parent sends why it ends.

    Messages to the parent are pairs: at most one COMPLAINT with the reason that ends the run, and
    at last DONE with what could not be kept, "" for nothing. If the parent dies, the run ends too,
    with everything that it had handed over.
    """
    # ^C stops the run, which the control process does in its own order; the recorder must see the
    # end of it.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        assignment: RecorderAssignment = parent.recv()
    except EOFError:
        return  # the parent started it in advance, and then had nothing to record
    try:
        queue = BlockQueue.attach(assignment.queue_name)
        writer = RunWriter(assignment.folder)
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
    """Moves blocks from the queue to the disk. A final refusal of the disk is reported once;
    later blocks are dropped.
    """

    def __init__(
        self, queue: BlockQueue, writer: RunWriter, clock: Clock, parent: Connection, patient: bool
    ) -> None:
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
        """Runs until the parent sends the end; returns why the run ends."""
        forced_s = self._clock.now_s()
        is_busy = False
        while True:
            # With work to do it does not wait, but still takes messages between two steps of that
            # work.
            self._listen(0.0 if is_busy else PAUSE_S)
            self._drain()
            # One small step only: the queue must be emptied while a stage file of many steps is
            # made.
            is_busy = self._run_unless_failed(self._writer.work)
            if self._clock.now_s() - forced_s > FORCED_EVERY_S:
                self._run_unless_failed(self._writer.force)
                forced_s = self._clock.now_s()
            self._tell()
            if self._why is not None:
                return self._why

    def close(self, why: str) -> str:
        """Takes what is still in the queue, ends the run's files, and returns what went wrong,
        "" for nothing.
        """
        self._drain()
        try:
            self._writer.close(why)
        except (RigError, OSError) as error:
            self._fault = self._fault or str(error)
        self._queue.tell(self._writer.acknowledged, bool(self._fault))
        return self._fault

    def _listen(self, wait_s: float | None) -> None:
        """Receives a photo, or the reason why the run ends, if either has arrived."""
        try:
            if self._parent.poll(wait_s):
                message = self._parent.recv()
                if isinstance(message, AnnouncedPhoto):
                    picture = message.receive(self._parent)
                    self._run_unless_failed(
                        lambda: self._writer.keep_picture(message.name, picture)
                    )
                    self._pictures.add(message.name)
                else:
                    self._why = str(message)
        except (EOFError, OSError):
            # A control process that was killed is an end like any other: the files are completed.
            self._why = CONTROL_GONE

    def _drain(self) -> None:
        blocks, length = parse_blocks(self._queue.look())
        self._run_unless_failed(lambda: self._take(blocks))
        # Only after the journal has the blocks: the queue's backlog then counts everything that is
        # not with the system yet.
        self._queue.consume(length)
        self._tell()

    def _take(self, blocks: list[JournalBlock]) -> None:
        for block in blocks:
            # The stage file is acknowledged only with its photo, which travels separately and may
            # arrive later.
            if block.kind is BlockKind.END:
                # Waits for the stage's photo, which is sent earlier but over the connection instead
                # of the queue.
                end = End.of(block)
                while (
                    end.static
                    and end.static.photo
                    and end.static.photo not in self._pictures
                    and self._why is None
                ):
                    self._listen(None)
            self._writer.take(block)
            if self._patient:
                self._writer.work_off()
        self._writer.flush()

    def _run_unless_failed(self, work: Callable[[], object]) -> bool:
        """Runs `work`; returns whether it has more to do. After a failure nothing is done any
        more.
        """
        if self._fault:
            return False
        try:
            return bool(work())
        except (RigError, OSError) as error:
            # A complaint about a full disk came first and is the cause of what failed after it.
            self._fault = self._writer.complaint or str(error)
            return False

    def _tell(self) -> None:
        complaint = self._writer.complaint or self._fault
        if complaint and not self._complained:
            self._complained = True
            _say(self._parent, COMPLAINT, complaint)
        self._queue.tell(self._writer.acknowledged, self._complained)


if __name__ == "__main__":
    # The run waits for this process to end: it is not to look for unused circles among all objects
    # before.
    atexit.register(gc.freeze)
    with Connection(int(sys.argv[1])) as parent:
        record_run(parent)
