"""A datagram link inside this process: nothing is lost on it, and nothing waits."""

from collections import deque
from typing import Protocol

from rfca_rig.errors import DeviceError


class DatagramLink(Protocol):
    """What a twin asks of its end, here or on a network."""

    def send(self, datagram: bytes) -> None: ...

    def receive_all(self) -> list[bytes]:
        """Everything that has arrived, oldest first; never waits."""
        ...

    def close(self) -> None: ...


class LinkEnd:
    """One end; what is sent here is received there, in order."""

    def __init__(self, outgoing: deque[bytes], incoming: deque[bytes]) -> None:
        self._outgoing = outgoing
        self._incoming = incoming
        self._open = True

    def send(self, datagram: bytes) -> None:
        """Raises DeviceError once this end is closed."""
        self._check_open()
        self._outgoing.append(datagram)

    def receive_all(self) -> list[bytes]:
        """Everything that has arrived, oldest first. Raises DeviceError once this end is closed."""
        self._check_open()
        received = list(self._incoming)
        self._incoming.clear()
        return received

    def close(self) -> None:
        self._open = False

    def _check_open(self) -> None:
        if not self._open:
            raise DeviceError("datagram link used after it was closed")


def datagram_link() -> tuple[LinkEnd, LinkEnd]:
    """Both ends, for the driver and for the twin."""
    there: deque[bytes] = deque()
    back: deque[bytes] = deque()
    return LinkEnd(there, back), LinkEnd(back, there)
