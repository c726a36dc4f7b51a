"""Writes a run: takes the blocks of the control loop one by one, and knows when a stage is safe on
disk.

Photos of static stages become lossless PNG files. A thread sends them to the recorder, so that the
control loop never waits.
"""

import importlib
import queue
import shutil
import threading
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from multiprocessing.connection import Connection
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from rfca_rig.errors import BadInput, DiskFull, RigError
from rfca_rig.recording.atomic import AppendOnlyFile, remove, sync_folder, write_atomically
from rfca_rig.recording.hdf5_file import Steps
from rfca_rig.recording.journal import BlockKind, End, JournalBlock, event_block, frame_block
from rfca_rig.recording.layout import (
    BALLAST,
    EVENTS,
    PHOTOS,
    STAGES,
    journal_path,
    next_number,
    stage_path,
)
from rfca_rig.recording.run_text import complete_lines_length, lock, read_header
from rfca_rig.recording.stage_file import StageOnDisk, write_stage

# PNG compression, 0 to 9: camera noise hardly compresses, and a higher level takes many times
# longer.
PACKING = 1
Picture = NDArray[np.uint8]


def next_photo(folder: Path) -> int:
    """Number of the run's next photo."""
    return (
        max(
            (int(file.stem) for file in (folder / PHOTOS).glob("*.png") if file.stem.isdecimal()),
            default=0,
        )
        + 1
    )


def photo_name(number: int) -> str:
    """Path of a photo in the run's folder."""
    return f"{PHOTOS}/{number:03d}.png"


def write_picture(path: Path, picture: Picture) -> None:
    """Returns when the picture (rows, columns, 3) is on disk. Raises RigError, DiskFull."""
    path.parent.mkdir(parents=True, exist_ok=True)
    # Imported only here: the recorder of a run without camera starts sooner.
    cv2 = importlib.import_module("cv2")
    encoded = cv2.imencode(".png", picture, [cv2.IMWRITE_PNG_COMPRESSION, PACKING])[1]
    write_atomically(path, encoded.tobytes())


@dataclass(frozen=True)
class AnnouncedPhoto:
    """Path and shape (rows, columns, 3) of a photo whose bytes come next."""

    name: str
    shape: tuple[int, ...]

    def receive(self, parent: Connection) -> Picture:
        """The photo (rows, columns, 3). Raises EOFError, OSError where the sender dies
        meanwhile.
        """
        return np.frombuffer(parent.recv_bytes(), np.uint8).reshape(self.shape)


class PhotoSender:
    """`send` queues a photo; `finish` returns when all are sent, or the recorder is gone."""

    def __init__(self, child: Connection) -> None:
        self._child = child
        self._waiting: queue.SimpleQueue[tuple[AnnouncedPhoto, Picture] | None] = (
            queue.SimpleQueue()
        )
        self._thread = threading.Thread(target=self._work, name="photos", daemon=True)

    def start(self) -> None:
        """Starts the thread, if that is not done. Raises RuntimeError where the system allows no
        further one.
        """
        # With the first photo: runs without a camera have no such thread.
        if not self._thread.ident:
            self._thread.start()

    def send(self, name: str, picture: Picture) -> None:
        """Queues a picture (rows, columns, 3), which the caller must not change any more."""
        self.start()
        self._waiting.put((AnnouncedPhoto(name, picture.shape), np.ascontiguousarray(picture)))

    def finish(self, within_s: float) -> None:
        """Ends the thread after the photos that are queued."""
        if self._thread.ident:
            self._waiting.put(None)
            self._thread.join(within_s)

    def _work(self) -> None:
        while (queued := self._waiting.get()) is not None:
            announced, picture = queued
            try:
                self._child.send(announced)
                self._child.send_bytes(picture.data.cast("B"))
            except OSError:
                # The control loop notices by itself that the recorder is gone.
                return


# A stroke of ten seconds at 15 kHz, compressed, and what is under way when the disk fills.
RESERVE_BYTES = 4 << 20
# Stage files and run.h5 each hold everything once.
ROOM_FACTOR = 2


def check_room(folder: Path, plan_bytes: int) -> None:
    """Raises BadInput where the disk has less than twice the room that the plan needs; `folder`
    need not exist yet.
    """
    existing = next(above for above in (folder, *folder.absolute().parents) if above.is_dir())
    needed = ROOM_FACTOR * plan_bytes + RESERVE_BYTES
    free = shutil.disk_usage(existing).free
    if free < needed:
        raise BadInput(
            f"{existing}: {1e-6 * free:.0f} MB free, the run may need {1e-6 * needed:.0f} "
            "MB; make room, or choose another disk with --runs"
        )


class DiskReserve:
    """A file whose only use is to be removed when the disk is full."""

    def __init__(self, folder: Path) -> None:
        self._path = folder / BALLAST

    def lay(self) -> None:
        """Allocates the reserve. Raises RigError where there is no room."""
        file = AppendOnlyFile(self._path)
        try:
            file.reserve(RESERVE_BYTES)
        except RigError:
            remove(self._path)
            raise
        finally:
            file.close()

    def release(self) -> bool:
        """Frees the reserve; False where it was already gone."""
        exists = self._path.exists()
        remove(self._path)
        return exists


class RunWriter:
    """Owns the folder of a run while it goes on.

    A stage that ends is safe in its journal. `work` makes its file from it, step by step, while the
    next stage may go on already. `acknowledged` stages are on disk, whatever happens later. A full
    disk uses up the reserve: what is under way is still recorded, and `complaint` then says that
    the run must stop.
    """

    def __init__(self, folder: Path) -> None:
        """`folder` was made by `run_folder.create`. Raises BadInput where another process writes
        into it.
        """
        self._folder = folder
        self._header = read_header(folder)
        self._events = AppendOnlyFile(folder / EVENTS)
        lock(self._events)
        # A crash may have left part of a line, to which the next event would be joined.
        self._events.cut_to(complete_lines_length((folder / EVENTS).read_bytes()))
        self._ballast = DiskReserve(folder)
        self._number = next_number(folder)
        self._journal: AppendOnlyFile | None = None
        self._waiting: list[bytes] = []
        # Stages whose journal is complete and whose file is still to be made, oldest first.
        self._ended: deque[int] = deque()
        self._making: Steps[StageOnDisk | None] | None = None
        self.acknowledged = 0
        self.complaint = ""

    def take(self, block: JournalBlock) -> None:
        """Raises RigError where the disk refuses for good. Samples reach the disk with `flush`,
        the file of a stage with `work`.
        """
        match block.kind:
            case BlockKind.EVENT:
                self._write_or_use_reserve(lambda: self._events.append(block.payload + b"\n"))
            case BlockKind.BEGIN:
                self._begin(block)
            case BlockKind.SAMPLES | BlockKind.START:
                # Gathered until `flush`: one system call for a tick's blocks.
                self._waiting.append(frame_block(block))
            case BlockKind.END:
                self._end(block)

    def flush(self) -> None:
        """Hands everything taken to the system: it then survives this process, though not yet a
        power cut.
        """
        waiting = b"".join(self._waiting)
        self._waiting = []
        if self._journal is not None and waiting:
            journal = self._journal
            self._write_or_use_reserve(lambda: journal.append(waiting))

    def work(self) -> bool:
        """Does one step towards the files of ended stages; False where there is nothing to do.
        Raises as `take` does.
        """
        if not self._ended:
            return False
        number = self._ended[0]
        journal = journal_path(self._folder, number)
        path = stage_path(self._folder, number)
        self._making = self._making or write_stage(journal, path, self._header)
        try:
            next(self._making)
        except StopIteration as done:
            self._making = None
            self._ended.popleft()
            self._acknowledge(journal, path, done.value)
        # Once the reserve is released there is room again: the file is begun again with the next
        # step.
        except DiskFull as full:
            self._making = None
            self._use_ballast(full)
        except BaseException:
            # A generator that has raised is exhausted: its next step would look like a stage
            # without samples, and cost its journal.
            self._making = None
            raise
        return True

    def work_off(self) -> None:
        """Returns when every ended stage is acknowledged."""
        while self.work():
            pass

    def keep_picture(self, name: str, picture: Picture) -> None:
        """Returns when the photo is on disk, at that path in the run's folder. Raises RigError
        where the disk finally refuses.
        """
        self._write_or_use_reserve(lambda: write_picture(self._folder / name, picture))

    def force(self) -> None:
        """Returns when everything flushed is on disk, and so survives a power cut too."""
        if self._journal is not None:
            self._journal.force()
        self._events.force()

    def close(self, why: str) -> None:
        """Ends the run; a stage in progress is cut short for the reason `why`. Removes the
        reserve.
        """
        try:
            if self._journal is not None:
                self._end(End(cut_short=why).block())
            self.work_off()
            self.take(event_block({"event": "run ends", "why": why}))
            # The event that names the end is the last word of the run; it must be on disk before
            # the lock is released.
            self._events.force()
        finally:
            self._events.close()
            self._ballast.release()

    def _begin(self, block: JournalBlock) -> None:
        self._journal = AppendOnlyFile(journal_path(self._folder, self._number))
        self._waiting = [frame_block(block)]

    def _end(self, block: JournalBlock) -> None:
        self._waiting.append(frame_block(block))
        self.flush()
        if self._journal is None:
            return
        self._journal.close()
        self._journal = None
        number = self._number
        self._number = self._number + 1
        self._ended.append(number)

    def _acknowledge(self, journal: Path, path: Path, written: StageOnDisk | None) -> None:
        """Records that the stage is on disk, and removes its journal. A stage without its photo
        is kept, but not acknowledged.
        """
        if written is not None:
            photo = ""
            if written.end.static:
                photo = written.end.static.photo
            has_photo = not photo or (self._folder / photo).is_file()
            self.acknowledged += has_photo
            notes = {}
            if not has_photo:
                notes["photo"] = f"{photo} is lost"
            event = written.event(f"{STAGES}/{path.name}", **notes)
            self._write_or_use_reserve(lambda: self._events.append(event))
            self._events.force()
        # Only after the event is on disk: as long as the journal exists, a crash loses neither
        # samples nor the record of them.
        remove(journal)

    def _write_or_use_reserve(self, write: Callable[[], object]) -> None:
        """Runs `write`; on a full disk once more, in the room of the reserve."""
        try:
            write()
        except DiskFull as full:
            self._use_ballast(full)
            write()

    def _use_ballast(self, full: DiskFull) -> None:
        """Releases the reserve for what the disk refused. Raises that error where the reserve is
        used up.
        """
        if not self._ballast.release():
            raise full
        self.complaint = f"stopped: disk full: {full}"
        # Forces the removal to disk, so that its room is really free before the write is tried
        # again.
        sync_folder(self._folder)
