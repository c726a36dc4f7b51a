"""In-process datagram link, without loss and without delay."""

from collections import deque
from typing import Protocol

from rfca_rig.errors import DeviceError


class DatagramLink(Protocol):
    """A twin's end of a datagram link, in-process or on a network."""

    def send(self, datagram: bytes) -> None: ...

    def receive_all(self) -> list[bytes]:
        """Everything that has arrived, oldest first; never waits."""
        ...

    def close(self) -> None: ...


class LinkEnd:
    """One end; datagrams sent here are received at the other end in order."""

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
    """Creates both ends: the driver's and the twin's."""
    to_twin: deque[bytes] = deque()
    to_driver: deque[bytes] = deque()
    return LinkEnd(to_twin, to_driver), LinkEnd(to_driver, to_twin)
