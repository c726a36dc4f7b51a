"""One connected client of a server that must not wait for it."""

import socket
from contextlib import suppress

MOST_WAITING = 4 << 20
BLOCK = 1 << 16


class TcpClient:
    """Bytes in and out without waiting. `open` turns false when the peer left, or stopped reading what it is sent."""

    def __init__(self, connection: socket.socket) -> None:
        connection.setblocking(False)
        connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self._connection = connection
        self._waiting = bytearray()
        self._finishing = False
        self.open = True

    def receive(self) -> bytes:
        """What has arrived, at most 64 KiB of it."""
        try:
            received = self._connection.recv(BLOCK)
        except BlockingIOError:
            return b""
        except OSError:
            self.open = False
            return b""
        self.open = self.open and received != b""
        return received

    def send(self, data: bytes) -> None:
        """Lets go of `data` now or, as far as the peer has no room, at the next `flush`."""
        self._waiting += data

    def flush(self) -> None:
        """Gives out what fits. A peer that left more than 4 MiB unread is let go: it would never catch up."""
        try:
            while self._waiting and self.open:
                del self._waiting[: self._connection.send(self._waiting)]
        except BlockingIOError:
            self.open = len(self._waiting) <= MOST_WAITING
        except OSError:
            self.open = False

    def finish(self) -> None:
        """To be closed once all is given out."""
        self._finishing = True

    @property
    def done(self) -> bool:
        """Whether there is nothing left to do but `close`."""
        return not self.open or (self._finishing and not self._waiting)

    def close(self) -> None:
        self.open = False
        with suppress(OSError):
            self._connection.shutdown(socket.SHUT_RDWR)
        self._connection.close()


def accept_all(listening: socket.socket) -> list[TcpClient]:
    """Everybody who has knocked since the last call."""
    clients: list[TcpClient] = []
    while True:
        try:
            connection, _ = listening.accept()
        except (BlockingIOError, ConnectionError):
            return clients
        clients.append(TcpClient(connection))
