"""Writes a run: takes the blocks of the control loop one by one, and knows when a stage is safe on disk."""

import shutil
from collections import deque
from collections.abc import Callable
from pathlib import Path

from rfca_rig.errors import BadInput, DiskFull, RigError
from rfca_rig.recording.atomic import AppendOnlyFile, remove, sync_folder
from rfca_rig.recording.hdf5_file import Steps
from rfca_rig.recording.journal import BlockKind, End, JournalBlock, event_block, frame_block
from rfca_rig.recording.layout import BALLAST, EVENTS, STAGES, journal_path, next_number, stage_path
from rfca_rig.recording.photos import Picture, write_picture
from rfca_rig.recording.run_text import complete_lines_length, lock, read_header
from rfca_rig.recording.stage_file import StageOnDisk, write_stage

# A stroke of ten seconds at 15 kHz, compressed, and what is under way when the disk fills.
RESERVE_BYTES = 4 << 20
# Stage files and run.h5 each hold everything once.
ROOM_FACTOR = 2


def check_room(folder: Path, plan_bytes: int) -> None:
    """Raises BadInput where the disk has less than twice the room that the plan needs; `folder` need not exist yet."""
    existing = next(above for above in (folder, *folder.absolute().parents) if above.is_dir())
    needed, free = ROOM_FACTOR * plan_bytes + RESERVE_BYTES, shutil.disk_usage(existing).free
    if free < needed:
        raise BadInput(
            f"{existing}: {1e-6 * free:.0f} MB free, the run may need {1e-6 * needed:.0f} MB; make room, or choose another disk with --runs"
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

    A stage that ends is safe in its journal. `work` makes its file from it, step by step, while the next stage may go on already.
    `acknowledged` stages are on disk, whatever happens later. A full disk uses up the reserve: what is under way is still recorded, and
    `complaint` then says that the run must stop.
    """

    def __init__(self, folder: Path) -> None:
        """`folder` was made by `run_folder.create`. Raises BadInput where another process writes into it."""
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
        """Raises RigError where the disk refuses for good. Samples reach the disk with `flush`, the file of a stage with `work`."""
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
        """Hands everything taken to the system: it then survives this process, though not yet a power cut."""
        waiting, self._waiting = b"".join(self._waiting), []
        if self._journal is not None and waiting:
            journal = self._journal
            self._write_or_use_reserve(lambda: journal.append(waiting))

    def work(self) -> bool:
        """Does one step towards the files of ended stages; False where there is nothing to do. Raises as `take` does."""
        if not self._ended:
            return False
        number = self._ended[0]
        journal, path = journal_path(self._folder, number), stage_path(self._folder, number)
        self._making = self._making or write_stage(journal, path, self._header)
        try:
            next(self._making)
        except StopIteration as done:
            self._making = None
            self._ended.popleft()
            self._acknowledge(journal, path, done.value)
        # Once the reserve is released there is room again: the file is begun again with the next step.
        except DiskFull as full:
            self._making = None
            self._use_ballast(full)
        except BaseException:
            # A generator that has raised is exhausted: its next step would look like a stage without samples, and cost its journal.
            self._making = None
            raise
        return True

    def work_off(self) -> None:
        """Returns when every ended stage is acknowledged."""
        while self.work():
            pass

    def keep_picture(self, name: str, picture: Picture) -> None:
        """Returns when the photo is on disk, at that path in the run's folder. Raises RigError where the disk finally refuses."""
        self._write_or_use_reserve(lambda: write_picture(self._folder / name, picture))

    def force(self) -> None:
        """Returns when everything flushed is on disk, and so survives a power cut too."""
        if self._journal is not None:
            self._journal.force()
        self._events.force()

    def close(self, why: str) -> None:
        """Ends the run; a stage in progress is cut short for the reason `why`. Removes the reserve."""
        try:
            if self._journal is not None:
                self._end(End(cut_short=why).block())
            self.work_off()
            self.take(event_block({"event": "run ends", "why": why}))
            # The event that names the end is the last word of the run; it must be on disk before the lock is
            # released.
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
        number, self._number = self._number, self._number + 1
        self._ended.append(number)

    def _acknowledge(self, journal: Path, path: Path, written: StageOnDisk | None) -> None:
        """Records that the stage is on disk, and removes its journal. A stage without its photo is kept, but not acknowledged."""
        if written is not None:
            photo = written.end.static.photo if written.end.static else ""
            has_photo = not photo or (self._folder / photo).is_file()
            self.acknowledged += has_photo
            event = written.event(f"{STAGES}/{path.name}", **({} if has_photo else {"photo": f"{photo} is lost"}))
            self._write_or_use_reserve(lambda: self._events.append(event))
            self._events.force()
        # Only after the event is on disk: as long as the journal exists, a crash loses neither samples nor the record
        # of them.
        remove(journal)

    def _write_or_use_reserve(self, write: Callable[[], object]) -> None:
        """Runs `write`; on a full disk once more, in the room of the reserve."""
        try:
            write()
        except DiskFull as full:
            self._use_ballast(full)
            write()

    def _use_ballast(self, full: DiskFull) -> None:
        """Releases the reserve for what the disk refused. Raises that error where the reserve is used up."""
        if not self._ballast.release():
            raise full
        self.complaint = f"stopped: disk full: {full}"
        # Forces the removal to disk, so that its room is really free before the write is tried again.
        sync_folder(self._folder)
