"""Web server of the Net F/T box: one page, one response per connection."""

from dataclasses import dataclass, replace

from rfca_rig.twin_server.faults import FaultPanel
from rfca_rig.twin_server.listening import listening_tcp
from rfca_rig.twin_server.tcp_client import TcpClient, accept_all
from rfca_rig.twins.netft import NetFtBoxTwin, Page

LONGEST_REQUEST = 8192
# Of one connection: a page takes milliseconds.
LONGEST_S = 10.0
REASONS = {200: "OK", 400: "Bad Request", 404: "Not Found", 405: "Method Not Allowed", 503: "Service Unavailable"}


@dataclass
class _Connection:
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
        self._connections: list[_Connection] = []

    def address(self) -> str:
        return f"Net F/T pages on HTTP {self._host}:{self.port}"

    def poll(self, now_s: float) -> None:
        self._connections += [_Connection(client, since_s=now_s) for client in accept_all(self._listening, len(self._connections))]
        for connection in self._connections:
            self._listen(connection)
            connection.client.flush(now_s)
            if now_s - connection.since_s > LONGEST_S:
                connection.client.open = False
        for connection in [connection for connection in self._connections if connection.client.done]:
            self._connections.remove(connection)
            connection.client.close()

    def _listen(self, connection: _Connection) -> None:
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
