"""What keeps a run: takes the blocks of the control loop one by one, and knows when a stage is safe."""

from collections import deque
from collections.abc import Callable
from pathlib import Path

from rfca_rig.errors import DiskFull
from rfca_rig.recording.atomic import GrowingFile, remove, sync_folder
from rfca_rig.recording.blocks import End, event_block
from rfca_rig.recording.cooperative import Steps
from rfca_rig.recording.disk_reserve import Ballast
from rfca_rig.recording.journal import BlockKind, JournalBlock, framed
from rfca_rig.recording.layout import EVENTS, STAGES, journal_path, next_number, stage_path
from rfca_rig.recording.picture import Picture, write_picture
from rfca_rig.recording.run_lock import lock
from rfca_rig.recording.run_text import read_header, whole_lines
from rfca_rig.recording.stage_file import Written, write_stage


class RunWriter:
    """Owns the folder of a run while it goes on.

    A stage that ends is safe in its journal, and made into its file by `work`, step by step, while the next may go on already.
    `acknowledged` stages are on disk, whatever comes. A full disk costs the ballast: what is under way is still kept, and `complaint`
    says from then on that the run must stop.
    """

    def __init__(self, folder: Path) -> None:
        """`folder` was made by `run_folder.create`. Raises BadInput where another process writes into it."""
        self._folder = folder
        self._header = read_header(folder)
        self._events = GrowingFile(folder / EVENTS)
        lock(self._events)
        self._events.cut_to(whole_lines((folder / EVENTS).read_bytes()))
        self._ballast = Ballast(folder)
        self._number = next_number(folder)
        self._journal: GrowingFile | None = None
        self._waiting: list[bytes] = []
        self._ended: deque[int] = deque()
        self._making: Steps[Written | None] | None = None
        self.acknowledged = 0
        self.complaint = ""

    def take(self, block: JournalBlock) -> None:
        """Raises RigError where the disk refuses for good. Samples reach the disk with `flush`, the file of a stage with `work`."""
        match block.kind:
            case BlockKind.EVENT:
                self._kept(lambda: self._events.append(block.payload + b"\n"))
            case BlockKind.BEGIN:
                self._begin(block)
            case BlockKind.SAMPLES | BlockKind.START:
                self._waiting.append(framed(block))
            case BlockKind.END:
                self._end(block)

    def flush(self) -> None:
        """Hands to the system what was taken: it survives this process, though not yet a power cut."""
        waiting, self._waiting = b"".join(self._waiting), []
        if self._journal is not None and waiting:
            journal = self._journal
            self._kept(lambda: journal.append(waiting))

    def work(self) -> bool:
        """Takes a step towards the files of stages that have ended; False where there is nothing to do. Raises as `take` does."""
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
        except DiskFull as full:
            self._making = None
            self._use_ballast(full)
        except BaseException:
            # A generator that has raised is exhausted: its next step would look like a stage without samples, and cost its journal.
            self._making = None
            raise
        return True

    def work_off(self) -> None:
        """Returns when every stage that has ended is acknowledged."""
        while self.work():
            pass

    def keep_picture(self, name: str, picture: Picture) -> None:
        """Returns when the photo is on disk, at that path from the run's folder. Raises RigError where the disk refuses for good."""
        self._kept(lambda: write_picture(self._folder / name, picture))

    def force(self) -> None:
        """Returns when what was flushed survives a power cut too."""
        if self._journal is not None:
            self._journal.force()
        self._events.force()

    def close(self, why: str) -> None:
        """Ends the run; a stage in progress is cut short, because of `why`. The ballast is taken away."""
        try:
            if self._journal is not None:
                self._end(End(cut_short=why).block())
            self.work_off()
            self.take(event_block({"event": "run ends", "why": why}))
            self._events.force()
        finally:
            self._events.close()
            self._ballast.release()

    def _begin(self, block: JournalBlock) -> None:
        self._journal = GrowingFile(journal_path(self._folder, self._number))
        self._waiting = [framed(block)]

    def _end(self, block: JournalBlock) -> None:
        self._waiting.append(framed(block))
        self.flush()
        if self._journal is None:
            return
        self._journal.close()
        self._journal = None
        number, self._number = self._number, self._number + 1
        self._ended.append(number)

    def _acknowledge(self, journal: Path, path: Path, written: Written | None) -> None:
        """Says that the stage is on disk, and takes the journal away. One whose photo is not there is kept, but not acknowledged."""
        if written is not None:
            photo = written.end.static.photo if written.end.static else ""
            has_photo = not photo or (self._folder / photo).is_file()
            self.acknowledged += has_photo
            said = written.event(f"{STAGES}/{path.name}", **({} if has_photo else {"photo": f"{photo} is lost"}))
            self._kept(lambda: self._events.append(said))
            self._events.force()
        remove(journal)

    def _kept(self, write: Callable[[], object]) -> None:
        """Writes, if need be into the room of the ballast."""
        try:
            write()
        except DiskFull as full:
            self._use_ballast(full)
            write()

    def _use_ballast(self, full: DiskFull) -> None:
        """Gives its room to what the disk refused. Raises that where there is none left."""
        if not self._ballast.release():
            raise full
        self.complaint = f"stopped: disk full: {full}"
        sync_folder(self._folder)
