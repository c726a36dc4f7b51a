"""What keeps a run: takes the blocks of the control loop one by one, and knows when a stage is safe."""

import hashlib
from collections.abc import Callable
from pathlib import Path

from rfca_rig.errors import DiskFull
from rfca_rig.recording.atomic import GrowingFile, remove, sync_folder
from rfca_rig.recording.ballast import Ballast
from rfca_rig.recording.blocks import End, event_block
from rfca_rig.recording.journal import Block, Kind, framed
from rfca_rig.recording.layout import EVENTS, STAGES, journal_path, next_number, stage_path
from rfca_rig.recording.run_lock import lock
from rfca_rig.recording.run_text import read_header, whole_lines
from rfca_rig.recording.stage_file import event_of, stage_in, write_stage


class RunWriter:
    """Owns the folder of a run while it goes on.

    A full disk costs the ballast: what is under way is still kept, and `complaint` says from then on that the run must stop.
    `acknowledged` stages are on disk, whatever comes.
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
        self.acknowledged = 0
        self.complaint = ""

    def take(self, block: Block) -> None:
        """Raises RigError where the disk refuses for good. Samples reach the disk with `flush`, ends of stages before it returns."""
        match block.kind:
            case Kind.EVENT:
                self._kept(lambda: self._events.append(block.payload + b"\n"))
            case Kind.BEGIN:
                self._begin(block)
            case Kind.SAMPLES | Kind.START:
                self._waiting.append(framed(block))
            case Kind.END:
                self._end(block)

    def flush(self) -> None:
        """Hands to the system what was taken: it survives this process, though not yet a power cut."""
        waiting, self._waiting = b"".join(self._waiting), []
        if self._journal is not None and waiting:
            journal = self._journal
            self._kept(lambda: journal.append(waiting))

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
            self.take(event_block({"event": "run ends", "why": why}))
            self._events.force()
        finally:
            self._events.close()
            self._ballast.release()

    def _begin(self, block: Block) -> None:
        self._journal = GrowingFile(journal_path(self._folder, self._number))
        self._waiting = [framed(block)]

    def _end(self, block: Block) -> None:
        self._waiting.append(framed(block))
        self.flush()
        if self._journal is None:
            return
        self._journal.close()
        self._journal = None
        number, self._number = self._number, self._number + 1
        self._acknowledge(number)

    def _acknowledge(self, number: int) -> None:
        """Puts the journal's stage into a file of its own, and takes the journal away."""
        journal = journal_path(self._folder, number)
        stage = stage_in(journal, self._header)
        if stage is not None:
            path = stage_path(self._folder, number)
            self._kept(lambda: write_stage(stage, path))
            said = event_of(stage, f"{STAGES}/{path.name}", hashlib.sha256(path.read_bytes()).hexdigest())
            self.acknowledged += 1
            self._kept(lambda: self._events.append(said))
            self._events.force()
        remove(journal)

    def _kept(self, write: Callable[[], object]) -> None:
        """Writes, if need be into the room of the ballast."""
        try:
            write()
        except DiskFull as full:
            if not self._ballast.release():
                raise
            self.complaint = f"stopped: disk full: {full}"
            sync_folder(self._folder)
            write()
