"""Room on the disk: enough of it before a run begins, and a reserve for bringing it to a good end when another program fills it."""

import shutil
from pathlib import Path

from rfca_rig.errors import BadInput, RigError
from rfca_rig.recording.atomic import GrowingFile, remove
from rfca_rig.recording.layout import BALLAST

BALLAST_BYTES = 4 << 20  # a stroke of ten seconds at 15 kHz, compressed, and what is under way when the disk fills
TIMES_PLAN = 2  # stage files and run.h5 hold everything once each


def check_room(folder: Path, plan_bytes: int) -> None:
    """Raises BadInput where the disk of `folder`, which need not be there yet, has not twice the room that the plan asks for."""
    there = next(above for above in (folder, *folder.absolute().parents) if above.is_dir())
    needed, free = TIMES_PLAN * plan_bytes + BALLAST_BYTES, shutil.disk_usage(there).free
    if free < needed:
        raise BadInput(
            f"{there}: {1e-6 * free:.0f} MB free, the run may need {1e-6 * needed:.0f} MB; make room, or choose another disk with --runs"
        )


class Ballast:
    """A file that is only there to be removed when the disk is full."""

    def __init__(self, folder: Path) -> None:
        self._path = folder / BALLAST

    def lay(self) -> None:
        """Takes the room. Raises RigError where there is none."""
        file = GrowingFile(self._path)
        try:
            file.reserve(BALLAST_BYTES)
        except RigError:
            remove(self._path)
            raise
        finally:
            file.close()

    def release(self) -> bool:
        """Gives the room back; False where it had been given already."""
        there = self._path.exists()
        remove(self._path)
        return there
