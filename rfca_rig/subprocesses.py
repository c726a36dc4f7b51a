"""Helper processes beside the one that runs a rig.

`multiprocessing` would import the main program's file again in the new process. A script that moves
a rig without a `__main__` guard would then open the rig twice. Therefore a new interpreter is
started, connected to this one by a socket pair.

With `-m` or `-c` alone, Python would search the current folder before its own library: a `numpy.py`
in a stranger's folder would run. Every interpreter is started with `python_command`, or within
`safe_path` where another library starts it.
"""

import os
import select
import socket
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from multiprocessing.connection import Connection

from rfca_rig.errors import RigError

SAFE_PATH_VARIABLE = "PYTHONSAFEPATH"


def can_be_started() -> bool:
    """Whether a child process can inherit a socket on this system."""
    return sys.platform != "win32"


def python_command(*arguments: str, python: str = sys.executable) -> list[str]:
    """The command that runs Python with these arguments, and imports nothing from the current
    folder.
    """
    return [python, "-P", *arguments]


@contextmanager
def safe_path() -> Iterator[None]:
    """Within it, interpreters that other libraries start import nothing from the current folder:
    workers, and multiprocessing's tracker.
    """
    before = os.environ.get(SAFE_PATH_VARIABLE)
    os.environ[SAFE_PATH_VARIABLE] = "1"
    try:
        yield
    finally:
        if before is None:
            os.environ.pop(SAFE_PATH_VARIABLE, None)
        else:
            os.environ[SAFE_PATH_VARIABLE] = before


Helper = tuple[subprocess.Popen[bytes], Connection]
"""A helper process, and the connection to it."""


def start(module: str) -> Helper:
    """Starts a helper process, which waits for its assignment.

    The process has its own session, so that neither ^C nor a closed terminal reaches it. `module`
    runs as a program; its argument is the number of its socket, over which it receives the
    assignment. Not on Windows, where processes cannot inherit a socket.
    """
    own_end, child_end = socket.socketpair()
    with child_end:
        command = python_command("-m", module, str(child_end.fileno()))
        process = subprocess.Popen(
            command, stdin=subprocess.DEVNULL, pass_fds=[child_end.fileno()], start_new_session=True
        )
    return process, Connection(own_end.detach())


def spawn(module: str, assignment: object) -> Helper:
    """Starts a helper process and sends it its assignment."""
    process, connection = start(module)
    connection.send(assignment)
    return process, connection


class HelperWatch:
    """Notices at every tick of the control loop that a helper process has ended, however it ended.

    The system closes the sockets of a process that ends, and reports that of the other end as hung
    up. Looking costs about a microsecond and receives nothing.
    """

    def __init__(self) -> None:
        self._poll: select.poll | None = None
        # With the connections, which must stay open: their numbers would be those of other files
        # otherwise.
        self._watched: dict[int, tuple[Connection, str]] = {}

    def add(self, connection: Connection, reason: str) -> None:
        """Watches the helper at the other end. `reason` is the error that its end raises."""
        # Made here, because systems on which no helper can be started have no `poll`.
        self._poll = self._poll or select.poll()
        # No events: what the helper has sent is nothing to look at, only that it has hung up.
        self._poll.register(connection.fileno(), 0)
        self._watched[connection.fileno()] = connection, reason

    def check(self) -> None:
        """Raises RigError if a helper has ended. Never waits."""
        if self._poll is None:
            return
        for fileno, _ in self._poll.poll(0):
            raise RigError(self._watched[fileno][1])
