"""Where the control loop hands its blocks: the interface, a recorder in the same process, and the
client of a recorder process.

With a process of its own, handing over takes microseconds, and every loss is reported.
"""

import errno
import subprocess
from collections.abc import Callable
from itertools import count
from pathlib import Path
from typing import Protocol

from rfca_rig.clock import WallClock
from rfca_rig.errors import NO_MORE_PROCESSES, DiskFull, RigError, Trip, Tripped
from rfca_rig.recording.block_queue import BlockQueue
from rfca_rig.recording.journal import JournalBlock, frame_block
from rfca_rig.recording.recorder_process import (
    COMPLAINT,
    DONE,
    READY,
    RecorderAssignment,
    start_recorder,
)
from rfca_rig.recording.run_writer import PhotoSender, Picture, RunWriter, next_photo, photo_name
from rfca_rig.subprocesses import Helper, HelperWatch

# 20 s of a sensor at 15 kHz.
QUEUE_BYTES = 16 << 20
# Less than the disk reserve: a rig faster than real time fills any queue before it learns of a full
# disk.
PATIENT_QUEUE_BYTES = 1 << 20
STARTED_WITHIN_S = 30.0
FINISHED_WITHIN_S = 120.0
SILENT_S = 2.0  # a recorder that works answers within tens of milliseconds
PATIENT_S = 30.0  # for which a twin's time stands still before the run ends
PAUSE_S = 0.002


class RunBackend(Protocol):
    """Records a run; `acknowledged` stages are on disk."""

    @property
    def acknowledged(self) -> int: ...

    @property
    def backlog_bytes(self) -> int:
        """Handed over, and not on its way to the disk yet."""
        ...

    def give(self, block: JournalBlock) -> None:
        """Hands over a block. Raises what ends the run: DiskFull, Tripped where the recorder
        cannot keep up, RigError where it has died.
        """
        ...

    def keep_photo(self, picture: Picture) -> str:
        """Takes over a photo (rows, columns, 3) of the stage that ends next; the caller must not
        change it any more.

        Returns its path in the run's folder. The stage is acknowledged when the photo, too, is on
        disk. Raises as `give` does.
        """
        ...

    def watch(self, helpers: HelperWatch) -> None:
        """Has the process that records watched, if there is one."""
        ...

    def finish(self, why: str) -> None:
        """Returns when everything is on disk; a stage in progress is cut short for the reason
        `why`.

        May be called any number of times. Raises RigError where something could not be recorded.
        """
        ...


class InProcessRecorder:
    """Writes at once, in the caller's own time: for tests, and systems on which no process can
    be started.
    """

    def __init__(self, folder: Path) -> None:
        self._writer = RunWriter(folder)
        self._photos = count(next_photo(folder))
        self._is_open = True

    @property
    def acknowledged(self) -> int:
        return self._writer.acknowledged

    @property
    def backlog_bytes(self) -> int:
        return 0

    def give(self, block: JournalBlock) -> None:
        self._writer.take(block)
        self._writer.flush()
        # No work is left over: the order of events is then the same every time.
        self._writer.work_off()
        self._check()

    def keep_photo(self, picture: Picture) -> str:
        name = photo_name(next(self._photos))
        self._writer.keep_picture(name, picture)
        self._check()
        return name

    def watch(self, helpers: HelperWatch) -> None:
        """There is no process of its own."""

    def _check(self) -> None:
        # Raised only after the block was written, in the room of the reserve.
        if self._writer.complaint:
            raise DiskFull(self._writer.complaint)

    def finish(self, why: str) -> None:
        if self._is_open:
            self._is_open = False
            self._writer.close(why)


class RecorderClient:
    """Implements `RunBackend` with a process of its own, which survives this one.

    A recorder so far behind that the queue is full ends the run. With `patient`, for rigs whose
    time stands still meanwhile, the caller waits instead.
    """

    def __init__(
        self,
        folder: Path,
        patient: bool,
        queue_bytes: int = 0,
        warn: Callable[[str], None] = lambda _: None,
        started: Helper | None = None,
    ) -> None:
        """Returns when the process is ready. `queue_bytes` 0 means the default size. Raises
        RigError where it cannot start.

        `warn` gets a line where the recorder takes longer than a disk that works would. `started`
        is a process from `start_recorder`, which has begun to import its modules already.
        """
        self._folder = folder
        self._warn = warn
        self._patient = patient
        self._clock = WallClock()
        usual_queue_bytes = PATIENT_QUEUE_BYTES if patient else QUEUE_BYTES
        self._queue = BlockQueue.create(queue_bytes or usual_queue_bytes)
        self._acknowledged = 0
        self._fault = ""
        self._complaint = ""
        try:
            self._process, self._child = started or start_recorder()
            self._child.send(RecorderAssignment(folder, self._queue.name, patient))
        except OSError as error:
            self._queue.remove()
            reason = NO_MORE_PROCESSES if error.errno == errno.EAGAIN else error.strerror or error
            raise RigError(f"{folder}: no process can be started to record: {reason}") from error
        self._photos = count(next_photo(folder))
        self._sender = PhotoSender(self._child)
        kind, message = self._receive(STARTED_WITHIN_S)
        if kind != READY:
            self._let_go()
            raise RigError(f"the recorder of {folder}: {message}")

    @property
    def process_id(self) -> int:
        """Of the recorder, for measuring its cost."""
        return self._process.pid

    @property
    def acknowledged(self) -> int:
        if self._child.closed:
            return self._acknowledged
        return self._queue.acknowledged

    @property
    def backlog_bytes(self) -> int:
        """Handed over and not taken yet."""
        if self._child.closed:
            return 0
        return self._queue.waiting

    def give(self, block: JournalBlock) -> None:
        content = frame_block(block)
        self._check()
        if self._queue.has_complained:
            # Events after the stop, for example `motor off`, are kept if possible, in the room of
            # the reserve.
            self._queue.put(content)
            raise self._complaint_error()
        if not self._queue.put(content):
            until_s = self._clock.now_s() + PATIENT_S
            warned_s = self._clock.now_s() + SILENT_S
            while not self._queue.put(content):
                if self._patient and self._clock.now_s() > warned_s:
                    warned_s = until_s
                    self._warn(
                        f"the disk under {self._folder} is silent; the twin waits for it, "
                        f"for {PATIENT_S:g} s at most"
                    )
                # A real rig must not wait for a disk: it stops, and the drive's watchdog never has
                # to.
                if not self._patient or self._clock.now_s() > until_s:
                    raise Tripped(
                        Trip.RECORDER_BEHIND,
                        f"the recorder is {1e-6 * self._queue.waiting:.1f} MB behind and "
                        f"its queue is full: the disk under {self._folder} "
                        "is too slow, or the machine too busy; record to another disk",
                    )
                self._wait()

    def keep_photo(self, picture: Picture) -> str:
        self._check()
        try:
            self._sender.start()
        except RuntimeError:
            # As an error of the camera, it costs the photo and not the run.
            self._warn(f"a photo was not kept: {NO_MORE_PROCESSES}")
            return ""
        name = photo_name(next(self._photos))
        self._sender.send(name, picture)
        return name

    def watch(self, helpers: HelperWatch) -> None:
        helpers.add(self._child, self._end_text())

    def _wait(self) -> None:
        """Waits for room, as long as the recorder lives and can make some."""
        self._clock.wait_until(self._clock.now_s() + PAUSE_S)
        self._check()
        if self._queue.has_complained:
            raise self._complaint_error()

    def _check(self) -> None:
        if self._process.poll() is not None:
            raise RigError(self._end_text())

    def _end_text(self) -> str:
        return (
            f"the recorder has ended by itself; what it had kept is in {self._folder}: type "
            f"rfca-rig recover {self._folder}"
        )

    def _complaint_error(self) -> RigError:
        # The message comes once; later calls repeat it.
        if not self._complaint:
            self._complaint = self._receive(1.0)[1]
        if "disk full" in self._complaint:
            return DiskFull(self._complaint)
        return RigError(self._complaint)

    def _receive(self, within_s: float) -> tuple[str, str]:
        try:
            if self._child.poll(within_s):
                kind, message = self._child.recv()
                return kind, message
        except (EOFError, OSError):
            # A recorder that died closes its end of the connection.
            return DONE, "it ended by itself"
        return DONE, f"no word within {within_s:g} s"

    def _is_silent(self) -> bool:
        try:
            return not self._child.poll(SILENT_S)
        except (EOFError, OSError):
            return False

    def finish(self, why: str) -> None:
        if not self._child.closed:
            self._fault = self._end_recorder(why)
            self._let_go()
        if self._fault:
            raise RigError(f"the recorder of {self._folder}: {self._fault}")

    def _end_recorder(self, why: str) -> str:
        # Photos first: the recorder stops listening once it has the reason for the end.
        self._sender.finish(FINISHED_WITHIN_S)
        try:
            self._child.send(why)
        except OSError:
            return "it ended by itself"
        if self._is_silent():
            self._warn(
                f"the disk under {self._folder} is silent; waiting for it, for "
                f"{FINISHED_WITHIN_S:g} s at most"
            )
        kind, message = self._receive(FINISHED_WITHIN_S)
        # A complaint may still be on its way; the answer to the end follows it.
        if kind == COMPLAINT:
            return self._receive(FINISHED_WITHIN_S)[1]
        return message

    def _let_go(self) -> None:
        # Read now: the shared memory is gone afterwards.
        self._acknowledged = self._queue.acknowledged
        self._child.close()
        try:
            self._process.wait(STARTED_WITHIN_S)
        except subprocess.TimeoutExpired:
            # A recorder that hangs in the disk must not keep the command from ending.
            self._process.kill()
            self._process.wait()
        self._queue.remove()
