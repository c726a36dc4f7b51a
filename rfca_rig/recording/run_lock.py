"""Lock of a run's folder: one process writes at a time. The lock ends with its process."""

import importlib
import os
from pathlib import Path

from rfca_rig.errors import BadInput
from rfca_rig.recording.atomic import AppendOnlyFile
from rfca_rig.recording.layout import EVENTS


def lock(events: AppendOnlyFile) -> None:
    """Locks the run until the file is closed. Raises BadInput where another process has the lock.

    On Windows, and on network disks without locks, there is no lock.
    """
    if os.name == "nt":
        return
    fcntl = importlib.import_module("fcntl")
    try:
        # On the open file, not by a file of its own: the system releases it however the process ends.
        fcntl.flock(events.handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        events.close()
        raise BadInput(f"{events.path.parent}: the run is still going on; wait for its end") from None
    except OSError:
        # A disk without locks must not prevent a run.
        return


def check_not_running(folder: Path) -> None:
    """Raises BadInput where the run in `folder` is still going on. Creates an empty file of events where there is none."""
    events = AppendOnlyFile(folder / EVENTS)
    lock(events)
    events.close()
