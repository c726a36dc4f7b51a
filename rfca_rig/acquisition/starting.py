"""How the acquisition process comes to be."""

import subprocess
import sys
from multiprocessing.connection import Connection

from rfca_rig import subprocesses
from rfca_rig.acquisition.process import AcquisitionAssignment, acquire

MODULE = "rfca_rig.acquisition.starting"


def started(assignment: AcquisitionAssignment) -> tuple[subprocess.Popen[bytes], Connection]:
    """The process at work, and the way to talk to it."""
    return subprocesses.started(MODULE, assignment)


if __name__ == "__main__":
    with Connection(int(sys.argv[1])) as parent:
        acquire(parent)
