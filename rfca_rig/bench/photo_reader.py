"""The process that finds the marks in the photos of a twin's run while the run goes on.

A process and not a thread: measuring marks holds the interpreter as long as the run does. Not
beside real hardware, whose control loop needs the cores.
"""

import signal
import subprocess
import sys
from collections import deque
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass
from multiprocessing.connection import Connection
from pathlib import Path
from types import TracebackType

import cv2

from rfca_rig import subprocesses
from rfca_rig.drivers.photo_files import read_picture
from rfca_rig.errors import BadInput
from rfca_rig.executors.cores import cores
from rfca_rig.subprocesses import HelperWatch
from rfca_rig.vision.identify import IdentifiedMarks
from rfca_rig.vision.leg_photo import PhotoSetup, read_marks

MODULE = "rfca_rig.bench.photo_reader"
# Interval in s at which the reader looks whether a photo has reached the disk.
LOOK_EVERY_S = 0.02
# A photo takes a tenth of a second. A reader that is silent for longer has died or hangs.
SILENT_S = 30.0


@dataclass(frozen=True)
class PhotoReaderAssignment:
    """The run's folder, and what reading a photo needs."""

    folder: Path
    eye: PhotoSetup


def can_read_beside() -> bool:
    """Whether this system can start the process, and has a core for it."""
    return subprocesses.can_be_started() and cores() > 1


class PhotoReader:
    """Reads photos in a process of its own. A photo that it did not read is read by the caller."""

    def __init__(self, folder: Path, eye: PhotoSetup) -> None:
        self._child: Connection | None = None
        self._process: subprocess.Popen[bytes] | None = None
        with suppress(OSError):
            self._process, self._child = subprocesses.spawn(
                MODULE, PhotoReaderAssignment(folder, eye)
            )

    def __enter__(self) -> "PhotoReader":
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()

    def watch(self, helpers: HelperWatch) -> None:
        """Has the process watched during the run: one that ends by itself was killed, as the
        system does where memory is short.
        """
        if self._child is not None:
            helpers.add(
                self._child,
                "the process that reads the photos has ended by itself; is there enough memory?",
            )

    def expect(self, photo: str) -> None:
        """Announces a photo by its path in the run's folder, which it may reach later."""
        self._send(photo)

    def collect(self) -> Mapping[str, IdentifiedMarks]:
        """Waits for the marks of all photos that are on disk, and ends the process. Photos that
        cannot be read are missing.
        """
        self._send("")
        marks: dict[str, IdentifiedMarks] = {}
        with suppress(EOFError, OSError):
            while (
                self._child is not None
                and self._child.poll(SILENT_S)
                and (answer := self._child.recv()) is not None
            ):
                marks |= answer
        self.close()
        return marks

    def close(self) -> None:
        """Ends the process, whatever it does."""
        if self._child is not None:
            self._child.close()
        if self._process is not None:
            self._process.kill()
            self._process.wait()
        self._child = self._process = None

    def _send(self, photo: str) -> None:
        # A reader that has died is noticed by `collect`.
        with suppress(OSError):
            if self._child is not None:
                self._child.send(photo)


def read_photos(parent: Connection) -> None:
    """Receives its assignment and the photos' paths, "" as the last one; then sends the marks of
    the photos by their paths, and None.
    """
    # ^C stops the run, which the control process does in its own order.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    # The other cores have the run and its recorder.
    cv2.setNumThreads(1)
    assignment: PhotoReaderAssignment = parent.recv()
    waiting: deque[str] = deque()
    marks: dict[str, IdentifiedMarks] = {}
    is_complete = False
    while waiting or not is_complete:
        if not is_complete and parent.poll(LOOK_EVERY_S if waiting else None):
            photo: str = parent.recv()
            if photo:
                waiting.append(photo)
            else:
                is_complete = True
        if waiting and (is_complete or (assignment.folder / waiting[0]).is_file()):
            name = waiting.popleft()
            # Those that cannot be read are read again by the control process, which reports what is
            # wrong.
            with suppress(BadInput):
                marks[name] = read_marks(read_picture(assignment.folder / name), assignment.eye)
        # Not before: until then the control process sends and does not receive, and each would wait
        # for the other.
        if is_complete:
            parent.send(marks)
            marks = {}
    parent.send(None)


if __name__ == "__main__":
    # A control process that has died needs no answer.
    with Connection(int(sys.argv[1])) as control, suppress(EOFError, OSError):
        read_photos(control)
