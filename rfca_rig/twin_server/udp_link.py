"""The sensor twin's datagram link over UDP; records go to the client that sent the last start request."""

import socket
from contextlib import suppress

from rfca_rig.codecs.malformed import MalformedFrame
from rfca_rig.codecs.rdt import RdtCommand, decode_request
from rfca_rig.twin_server.listening import bound_udp

STARTS = frozenset({RdtCommand.START_SINGLE, RdtCommand.START_BUFFERED})
LONGEST_REQUEST = 2048
# Taken in one step of the server's millisecond; a client sends a handful. A sender that floods must not keep the loop here.
MOST_REQUESTS = 100
# After a delay the twin sends many datagrams at once.
SEND_BUFFER_BYTES = 1 << 20


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
                request, sender = self._socket.recvfrom(LONGEST_REQUEST)
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
