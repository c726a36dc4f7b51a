"""Who writes into a run's folder: one process at a time, told by a lock that vanishes with it."""

import importlib
import os
from pathlib import Path

from rfca_rig.errors import BadInput
from rfca_rig.recording.atomic import GrowingFile
from rfca_rig.recording.layout import EVENTS


def lock(events: GrowingFile) -> None:
    """Holds the run's lock until the file is closed. Raises BadInput where another process holds it.

    Windows, and network disks without locks, go without.
    """
    if os.name == "nt":
        return
    fcntl = importlib.import_module("fcntl")
    try:
        fcntl.flock(events.handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        events.close()
        raise BadInput(f"{events.path.parent}: the run is still going on; wait for its end") from None
    except OSError:
        return  # a disk without locks


def check_over(folder: Path) -> None:
    """Raises BadInput where the run in `folder` is still going on. Leaves a file of events there, if only an empty one."""
    events = GrowingFile(folder / EVENTS)
    lock(events)
    events.close()
