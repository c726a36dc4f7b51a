"""Disk space: a check before a run begins, and a reserve to complete the run when another program fills the disk."""

import shutil
from pathlib import Path

from rfca_rig.errors import BadInput, RigError
from rfca_rig.recording.atomic import AppendOnlyFile, remove
from rfca_rig.recording.layout import BALLAST

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
