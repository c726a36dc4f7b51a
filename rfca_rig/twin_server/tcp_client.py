"""Non-blocking connection to one TCP client."""

import errno
import socket
from contextlib import suppress

# Limit of the send queue, and largest read, in bytes.
MAX_QUEUED_BYTES = 4 << 20
BLOCK = 1 << 16
# Of one port. Some five ports of these stay far below the 1024 files that a process may usually have open.
MAX_CLIENTS = 64
# A client that neither sends nor is sent anything for so long is disconnected; one that hung would keep its place for ever.
# A person at a control line pauses for minutes; a bus, even a quiet one, brings frames every second.
IDLE_S = 300.0
# A browser can send these to any port of its own machine, from any page: no device speaks so.
HTTP_METHODS = (b"GET ", b"POST ", b"PUT ", b"DELETE ", b"HEAD ", b"OPTIONS ", b"PATCH ", b"CONNECT ", b"TRACE ")


class TcpClient:
    """Sends and receives without waiting. `open` becomes false when the client left, stopped reading, or was idle for IDLE_S."""

    def __init__(self, connection: socket.socket) -> None:
        connection.setblocking(False)
        # Small frames must not wait for the acknowledgement of the ones before (Nagle).
        connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self._connection = connection
        self._waiting = bytearray()
        self._finishing = False
        self._has_moved = False
        self._active_s: float | None = None
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
        self._has_moved = True
        return received

    def send(self, data: bytes) -> None:
        """Queues `data` for the next `flush`."""
        self._waiting += data

    def flush(self, now_s: float) -> None:
        """Sends what fits. A client with more than 4 MiB unread is disconnected: it would never catch up."""
        self._send_waiting()
        if self._has_moved or self._active_s is None:
            self._has_moved, self._active_s = False, now_s
        elif now_s - self._active_s > IDLE_S:
            self.open = False

    def _send_waiting(self) -> None:
        try:
            while self._waiting and self.open:
                del self._waiting[: self._connection.send(self._waiting)]
                self._has_moved = True
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


def accept_all(listening: socket.socket, connected: int) -> list[TcpClient]:
    """Accepts the clients that have connected since the last call, beside `connected` ones; beyond MAX_CLIENTS they are disconnected."""
    clients: list[TcpClient] = []
    # Who connects again and again must not keep the loop here.
    for _ in range(MAX_CLIENTS):
        try:
            connection, _ = listening.accept()
        except (BlockingIOError, ConnectionError):
            break
        except OSError as error:
            # No file left in this process or system: who waits is accepted once others have gone.
            if error.errno in (errno.EMFILE, errno.ENFILE):
                break
            raise
        if connected + len(clients) < MAX_CLIENTS:
            clients.append(TcpClient(connection))
        else:
            connection.close()
    return clients


def is_http(received: bytes) -> bool:
    """Whether a client begins as a browser does."""
    return received.startswith(HTTP_METHODS)
