"""A process of this package beside the one that runs a rig.

`multiprocessing` would run the main program's file once more in the new process: with a script that moves a rig and has no guard
against that, the rig would be opened twice. So it is an interpreter of its own, tied to this one by a pair of sockets.
"""

import socket
import subprocess
import sys
from multiprocessing.connection import Connection


def can_be_started() -> bool:
    """Whether this system lets a process inherit a socket."""
    return sys.platform != "win32"


def started(module: str, assignment: object) -> tuple[subprocess.Popen[bytes], Connection]:
    """The process at work, and the way to talk to it; of a session of its own, so that neither ^C nor a closed terminal reaches it.

    `module` runs as a program, is given the number of its socket, and receives the assignment there. Not on Windows, where no process
    can inherit a socket.
    """
    here, there = socket.socketpair()
    with there:
        words = [sys.executable, "-m", module, str(there.fileno())]
        process = subprocess.Popen(words, stdin=subprocess.DEVNULL, pass_fds=[there.fileno()], start_new_session=True)
    child = Connection(here.detach())
    child.send(assignment)
    return process, child
