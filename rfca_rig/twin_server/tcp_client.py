"""Non-blocking connection to one TCP client."""

import socket
from contextlib import suppress

# Limit of the send queue, and largest read, in bytes.
MAX_QUEUED_BYTES = 4 << 20
BLOCK = 1 << 16


class TcpClient:
    """Sends and receives without waiting. `open` becomes false when the client left, or stopped reading."""

    def __init__(self, connection: socket.socket) -> None:
        connection.setblocking(False)
        # Small frames must not wait for the acknowledgement of the ones before (Nagle).
        connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self._connection = connection
        self._waiting = bytearray()
        self._finishing = False
        self.open = True

    def receive(self) -> bytes:
        """Bytes that have arrived, at most 64 KiB."""
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
        """Queues `data` for the next `flush`."""
        self._waiting += data

    def flush(self) -> None:
        """Sends what fits. A client with more than 4 MiB unread is disconnected: it would never catch up."""
        try:
            while self._waiting and self.open:
                del self._waiting[: self._connection.send(self._waiting)]
        except BlockingIOError:
            self.open = len(self._waiting) <= MAX_QUEUED_BYTES
        except OSError:
            self.open = False

    def finish(self) -> None:
        """Marks the connection to be closed once everything is sent."""
        self._finishing = True

    @property
    def done(self) -> bool:
        """Whether only `close` is left to do."""
        return not self.open or (self._finishing and not self._waiting)

    def close(self) -> None:
        self.open = False
        with suppress(OSError):
            self._connection.shutdown(socket.SHUT_RDWR)
        self._connection.close()


def accept_all(listening: socket.socket) -> list[TcpClient]:
    """Accepts all clients that have connected since the last call."""
    clients: list[TcpClient] = []
    while True:
        try:
            connection, _ = listening.accept()
        except (BlockingIOError, ConnectionError):
            return clients
        clients.append(TcpClient(connection))
