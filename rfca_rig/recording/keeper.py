"""Interface to which the control loop hands its blocks, and the implementation that writes in the same process."""

from itertools import count
from pathlib import Path
from typing import Protocol

from rfca_rig.errors import DiskFull
from rfca_rig.recording.journal import JournalBlock
from rfca_rig.recording.picture import Picture, next_photo, photo_name
from rfca_rig.recording.run_writer import RunWriter


class RunBackend(Protocol):
    """Records a run; `acknowledged` stages are on disk."""

    @property
    def acknowledged(self) -> int: ...

    @property
    def backlog_bytes(self) -> int:
        """Handed over, and not on its way to the disk yet."""
        ...

    def give(self, block: JournalBlock) -> None:
        """Hands over a block. Raises what ends the run: DiskFull, Tripped where the recorder cannot keep up, RigError where it has died."""
        ...

    def keep_photo(self, picture: Picture) -> str:
        """Takes over a photo (rows, columns, 3) of the stage that ends next; the caller must not change it any more.

        Returns its path in the run's folder. The stage is acknowledged when the photo, too, is on disk. Raises as `give` does.
        """
        ...

    def finish(self, why: str) -> None:
        """Returns when everything is on disk; a stage in progress is cut short for the reason `why`.

        May be called any number of times. Raises RigError where something could not be recorded.
        """
        ...


class InProcessRecorder:
    """Writes at once, in the caller's own time: for tests, and systems on which no process can be started."""

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

    def _check(self) -> None:
        # Raised only after the block was written, in the room of the reserve.
        if self._writer.complaint:
            raise DiskFull(self._writer.complaint)

    def finish(self, why: str) -> None:
        if self._is_open:
            self._is_open = False
            self._writer.close(why)
