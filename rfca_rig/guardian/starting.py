"""How the guardian comes to be."""

import subprocess
import sys
from multiprocessing.connection import Connection

from rfca_rig import subprocesses
from rfca_rig.guardian.process import GuardianAssignment, guard

MODULE = "rfca_rig.guardian.starting"


def started(assignment: GuardianAssignment) -> tuple[subprocess.Popen[bytes], Connection]:
    """The process, and the way to talk to it."""
    return subprocesses.started(MODULE, assignment)


if __name__ == "__main__":
    with Connection(int(sys.argv[1])) as parent:
        guard(parent)
