"""Ports of the Net F/T box: commands over TCP, its web page, and its records over UDP."""

import socket
from contextlib import suppress
from dataclasses import dataclass, replace

from rfca_rig.codecs.netft_configuration import COMMAND_BYTES
from rfca_rig.codecs.rdt import RdtCommand, decode_request
from rfca_rig.errors import MalformedFrame
from rfca_rig.twin_server.faults import FaultPanel
from rfca_rig.twin_server.tcp import TcpClient, accept_all, bound_udp, listening_tcp
from rfca_rig.twins.netft import NetFtBoxTwin, Page

LONGEST_REQUEST = 8192
# Of one connection: a page takes milliseconds.
LONGEST_S = 10.0
REASONS = {200: "OK", 400: "Bad Request", 404: "Not Found", 405: "Method Not Allowed", 503: "Service Unavailable"}
STARTS = frozenset({RdtCommand.START_SINGLE, RdtCommand.START_BUFFERED})
LONGEST_DATAGRAM = 2048
# Taken in one step of the server's millisecond; a client sends a handful. A sender that floods must not keep the loop here.
MOST_REQUESTS = 100
# After a delay the twin sends many datagrams at once.
SEND_BUFFER_BYTES = 1 << 20


@dataclass
class _Connection:
    client: TcpClient
    rest: bytes = b""


class CommandPort:
    """Serves any number of clients at once. Write commands are not answered."""

    def __init__(self, box: NetFtBoxTwin, host: str, port: int) -> None:
        self._box = box
        self._listening = listening_tcp(host, port)
        self._host, self.port = self._listening.getsockname()
        self._connections: list[_Connection] = []

    def address(self) -> str:
        return f"Net F/T commands on TCP {self._host}:{self.port}"

    def poll(self, now_s: float) -> None:
        self._connections += [_Connection(client) for client in accept_all(self._listening, len(self._connections))]
        for connection in self._connections:
            connection.rest += connection.client.receive()
            # TCP has no message borders: commands are cut from the byte stream by their length.
            while len(connection.rest) >= COMMAND_BYTES:
                connection.client.send(self._box.answer(connection.rest[:COMMAND_BYTES]))
                connection.rest = connection.rest[COMMAND_BYTES:]
            connection.client.flush(now_s)
        for connection in [connection for connection in self._connections if connection.client.done]:
            self._connections.remove(connection)
            connection.client.close()

    def close(self) -> None:
        for connection in self._connections:
            connection.client.close()
        self._connections.clear()
        self._listening.close()


@dataclass
class _HttpConnection:
    client: TcpClient
    request: bytes = b""
    answered: bool = False
    since_s: float = 0.0


class HttpPort:
    """Serves GET only. The faults `http-busy` and `force-scale` act here; the latter also changes the configuration page."""

    def __init__(self, box: NetFtBoxTwin, panel: FaultPanel, host: str, port: int) -> None:
        self._box = box
        self._panel = panel
        self._as_set = box.configuration
        self._listening = listening_tcp(host, port)
        self._host, self.port = self._listening.getsockname()
        self._connections: list[_HttpConnection] = []

    def address(self) -> str:
        return f"Net F/T pages on HTTP {self._host}:{self.port}"

    def poll(self, now_s: float) -> None:
        self._connections += [_HttpConnection(client, since_s=now_s) for client in accept_all(self._listening, len(self._connections))]
        for connection in self._connections:
            self._listen(connection)
            connection.client.flush(now_s)
            if now_s - connection.since_s > LONGEST_S:
                connection.client.open = False
        for connection in [connection for connection in self._connections if connection.client.done]:
            self._connections.remove(connection)
            connection.client.close()

    def _listen(self, connection: _HttpConnection) -> None:
        connection.request += connection.client.receive()
        # The request is complete at the empty line; one that is too long is answered as far as it came.
        if connection.answered or (b"\r\n\r\n" not in connection.request and len(connection.request) <= LONGEST_REQUEST):
            return
        connection.answered = True
        connection.client.send(_bytes(self._answer(connection.request.split(b"\r\n")[0].decode("ascii", "replace").split())))
        # HTTP with "Connection: close": the client sees the end of the page by the end of the connection.
        connection.client.finish()

    def _answer(self, words: list[str]) -> Page:
        if len(words) != 3 or not words[2].startswith("HTTP/1."):
            return Page(400, "text/plain", b"not a request")
        if words[0] != "GET":
            return Page(405, "text/plain", b"GET only")
        self._box.busy = self._panel.is_on("http-busy")
        doubled = 2.0 if self._panel.is_on("force-scale") else 1.0
        counts = self._as_set.counts_per_force * doubled, self._as_set.counts_per_torque * doubled
        # Set again for each request, as the fault may have been switched since the last one.
        self._box.configuration = replace(self._as_set, counts_per_force=counts[0], counts_per_torque=counts[1])
        return self._box.page(words[1])

    def close(self) -> None:
        for connection in self._connections:
            connection.client.close()
        self._connections.clear()
        self._listening.close()


def _bytes(page: Page) -> bytes:
    head = (
        f"HTTP/1.1 {page.status} {REASONS.get(page.status, 'Unknown')}",
        f"Content-Type: {page.content_type}",
        f"Content-Length: {len(page.body)}",
        "Connection: close",
    )
    return "\r\n".join(head).encode("ascii") + b"\r\n\r\n" + page.body


class UdpLink:
    """Sends records to the source of the last start request: a second client takes the stream from the first, as on the box.

    A datagram that the network refuses is lost, like one lost on the way.
    """

    def __init__(self, host: str, port: int) -> None:
        self._socket = bound_udp(host, port)
        self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, SEND_BUFFER_BYTES)
        self._host, self.port = self._socket.getsockname()
        self._listener: tuple[str, int] | None = None

    def address(self) -> str:
        return f"Net F/T RDT on UDP {self._host}:{self.port}"

    def send(self, datagram: bytes) -> None:
        if self._listener is not None:
            with suppress(OSError):
                self._socket.sendto(datagram, self._listener)

    def receive_all(self) -> list[bytes]:
        """Requests since the last call, oldest first; never waits."""
        requests: list[bytes] = []
        for _ in range(MOST_REQUESTS):
            try:
                request, sender = self._socket.recvfrom(LONGEST_DATAGRAM)
            except BlockingIOError:
                break
            # ICMP "port unreachable" for an earlier datagram: its receiver is gone.
            except ConnectionError:
                continue
            self._note(request, sender)
            requests.append(request)
        return requests

    def _note(self, request: bytes, sender: tuple[str, int]) -> None:
        try:
            starts = decode_request(request).command in STARTS
        except MalformedFrame:
            return
        if starts:
            self._listener = sender

    def close(self) -> None:
        self._socket.close()
