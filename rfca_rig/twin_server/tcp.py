"""Listening sockets of the server, and non-blocking connections to TCP clients."""

import errno
import socket
from contextlib import suppress
from ipaddress import ip_address

from rfca_rig.errors import NO_SUCH_ADDRESS, BadInput

LOOPBACK = "127.0.0.1"
ANY_FREE = 0

# Limit of the send queue, and largest read, in bytes.
MAX_QUEUED_BYTES = 4 << 20
BLOCK = 1 << 16
# Of one port. Some five ports of these stay far below the 1024 files that a process may usually
# have open.
MAX_CLIENTS = 64
# A client that neither sends nor is sent anything for so long is disconnected; one that hung would
# keep its place for ever. A person at a control line pauses for minutes; a bus, even a quiet one,
# brings frames every second.
IDLE_S = 300.0
# A browser can send these to any port of its own machine, from any page: no device speaks so.
HTTP_METHODS = (
    b"GET ",
    b"POST ",
    b"PUT ",
    b"DELETE ",
    b"HEAD ",
    b"OPTIONS ",
    b"PATCH ",
    b"CONNECT ",
    b"TRACE ",
)


def listening_tcp(host: str, port: int) -> socket.socket:
    """Opens a non-blocking listening TCP socket. Raises BadInput if host and port are not
    available.
    """
    return _bind(socket.SOCK_STREAM, host, port)


def bound_udp(host: str, port: int) -> socket.socket:
    """Opens a non-blocking UDP socket. Raises BadInput if host and port are not available."""
    return _bind(socket.SOCK_DGRAM, host, port)


def _bind(kind: socket.SocketKind, host: str, port: int) -> socket.socket:
    opened = socket.socket(socket.AF_INET, kind)
    try:
        if kind == socket.SOCK_STREAM:
            # A restarted server can take its port again at once, although old connections are still
            # in TIME_WAIT.
            opened.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        opened.bind((host, port))
        if kind == socket.SOCK_STREAM:
            opened.listen()
    except (OSError, OverflowError) as error:
        opened.close()
        if getattr(error, "errno", None) == errno.EADDRNOTAVAIL:
            raise BadInput(f"cannot listen on {host}: {NO_SUCH_ADDRESS}") from error
        raise BadInput(
            f"cannot listen on {host} port {port}: {error}; another server may be "
            "running, port 0 takes any free one"
        ) from error
    opened.setblocking(False)
    return opened


def is_loopback(host: str) -> bool:
    """Whether only this machine can reach `host`. Raises BadInput unless it is an IPv4 address."""
    try:
        address = ip_address(host)
    except ValueError as error:
        raise BadInput(
            f"{host!r} is no address to listen on; write it in numbers, as 127.0.0.1 or "
            "192.168.1.10"
        ) from error
    if address.version != 4:
        raise BadInput(
            f"{host}: the twin listens on IPv4 only; for this machine that is {LOOPBACK}"
        )
    return address.is_loopback


class TcpClient:
    """Sends and receives without waiting. `open` becomes false when the client left, stopped
    reading, or was idle for IDLE_S.
    """

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
        """Sends what fits. A client with more than 4 MiB unread is disconnected: it would never
        catch up.
        """
        self._send_waiting()
        if self._has_moved or self._active_s is None:
            self._has_moved = False
            self._active_s = now_s
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
    """Accepts the clients that have connected since the last call, beside `connected` ones;
    beyond MAX_CLIENTS they are disconnected.
    """
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
