"""Start of the acquisition process; also its main module."""

import subprocess
import sys
from multiprocessing.connection import Connection

from rfca_rig import subprocesses
from rfca_rig.acquisition.process import AcquisitionAssignment, run_acquisition

MODULE = "rfca_rig.acquisition.starting"


def start_acquisition(assignment: AcquisitionAssignment) -> tuple[subprocess.Popen[bytes], Connection]:
    """Starts the acquisition process; returns it and a connection to it."""
    return subprocesses.spawn(MODULE, assignment)


if __name__ == "__main__":
    with Connection(int(sys.argv[1])) as parent:
        run_acquisition(parent)
