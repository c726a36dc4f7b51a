"""Start of the guardian process; also its main module."""

import subprocess
import sys
from multiprocessing.connection import Connection

from rfca_rig import subprocesses
from rfca_rig.guardian.process import GuardianAssignment, run_guardian

MODULE = "rfca_rig.guardian.starting"


def start_guardian(assignment: GuardianAssignment) -> tuple[subprocess.Popen[bytes], Connection]:
    """Starts the guardian process; returns it and a connection to it."""
    return subprocesses.spawn(MODULE, assignment)


if __name__ == "__main__":
    with Connection(int(sys.argv[1])) as parent:
        run_guardian(parent)
