"""The Net F/T box's web server: one page, one answer per connection."""

from dataclasses import dataclass, replace

from rfca_rig.twin_server.faults import FaultPanel
from rfca_rig.twin_server.listening import listening_tcp
from rfca_rig.twin_server.tcp_client import TcpClient, accept_all
from rfca_rig.twins.netft_box import NetFtBoxTwin, Page

LONGEST_REQUEST = 8192
REASONS = {200: "OK", 400: "Bad Request", 404: "Not Found", 405: "Method Not Allowed", 503: "Service Unavailable"}


@dataclass
class _Visit:
    client: TcpClient
    request: bytes = b""
    answered: bool = False


class HttpPort:
    """GET only. The faults of the box's pages act here: `http-busy`, and `force-scale`, which its configuration then says too."""

    def __init__(self, box: NetFtBoxTwin, panel: FaultPanel, host: str, port: int) -> None:
        self._box = box
        self._panel = panel
        self._as_set = box.configuration
        self._listening = listening_tcp(host, port)
        self._host, self.port = self._listening.getsockname()
        self._visits: list[_Visit] = []

    def address(self) -> str:
        return f"Net F/T pages on HTTP {self._host}:{self.port}"

    def poll(self, now_s: float) -> None:  # noqa: ARG002 (answers at once)
        self._visits += [_Visit(client) for client in accept_all(self._listening)]
        for visit in self._visits:
            self._listen(visit)
            visit.client.flush()
        for visit in [visit for visit in self._visits if visit.client.done]:
            self._visits.remove(visit)
            visit.client.close()

    def _listen(self, visit: _Visit) -> None:
        visit.request += visit.client.receive()
        if visit.answered or (b"\r\n\r\n" not in visit.request and len(visit.request) <= LONGEST_REQUEST):
            return
        visit.answered = True
        visit.client.send(_bytes(self._answer(visit.request.split(b"\r\n")[0].decode("ascii", "replace").split())))
        visit.client.finish()

    def _answer(self, words: list[str]) -> Page:
        if len(words) != 3 or not words[2].startswith("HTTP/1."):
            return Page(400, "text/plain", b"not a request")
        if words[0] != "GET":
            return Page(405, "text/plain", b"GET only")
        self._box.busy = self._panel.is_on("http-busy")
        doubled = 2.0 if self._panel.is_on("force-scale") else 1.0
        counts = self._as_set.counts_per_force * doubled, self._as_set.counts_per_torque * doubled
        self._box.configuration = replace(self._as_set, counts_per_force=counts[0], counts_per_torque=counts[1])
        return self._box.page(words[1])

    def close(self) -> None:
        for visit in self._visits:
            visit.client.close()
        self._visits.clear()
        self._listening.close()


def _bytes(page: Page) -> bytes:
    head = (
        f"HTTP/1.1 {page.status} {REASONS.get(page.status, 'Unknown')}",
        f"Content-Type: {page.content_type}",
        f"Content-Length: {len(page.body)}",
        "Connection: close",
    )
    return "\r\n".join(head).encode("ascii") + b"\r\n\r\n" + page.body
