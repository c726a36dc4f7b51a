"""How the acquisition process comes to be.

`multiprocessing` would run the main program's file once more in the new process: with a script that moves a rig and has no guard
against that, the rig would be opened twice. So it is an interpreter of its own, tied to this one by a pair of sockets.
"""

import socket
import subprocess
import sys
from multiprocessing.connection import Connection

from rfca_rig.acquisition.process import Assignment, acquire

MODULE = "rfca_rig.acquisition.starting"


def can_be_started() -> bool:
    """Whether this system lets a process inherit a socket."""
    return sys.platform != "win32"


def started(assignment: Assignment) -> tuple[subprocess.Popen[bytes], Connection]:
    """The process at work, and the way to talk to it; it is of a session of its own, so that ^C does not reach it."""
    here, there = socket.socketpair()
    with there:
        words = [sys.executable, "-m", MODULE, str(there.fileno())]
        process = subprocess.Popen(words, stdin=subprocess.DEVNULL, pass_fds=[there.fileno()], start_new_session=True)
    child = Connection(here.detach())
    child.send(assignment)
    return process, child


if __name__ == "__main__":
    with Connection(int(sys.argv[1])) as parent:
        acquire(parent)
