"""CAN over TCP in the protocol of socketcand: any number of clients on one bus."""

from dataclasses import dataclass

from rfca_rig.codecs import socketcand
from rfca_rig.codecs.malformed import MalformedFrame
from rfca_rig.twin_server.listening import listening_tcp
from rfca_rig.twin_server.shared_wire import SharedWire, frame_of, is_classic, message_of
from rfca_rig.twin_server.tcp_client import TcpClient, accept_all, is_http
from rfca_rig.twins.wires import CanEnd

NEVER = float("inf")
# Clients expect the answer to `rawmode` alone in their next read, so frames are held back for this long.
FRAME_DELAY_S = 0.05


@dataclass
class _Member:
    """A client, its end of the bus, and the time from which it is sent frames; never unless it requested raw mode."""

    client: TcpClient
    end: CanEnd
    told_from_s: float = NEVER
    is_open: bool = False
    rest: bytes = b""


class SocketcandPort:
    """Answers `open`, `rawmode`, `bcmmode`, `echo` and `send`; everything else is refused with an `error` message.

    Every bus name leads to the same bus. Frames carry the time since the epoch; `epoch_s` is that of the clock's zero.
    """

    def __init__(self, wire: SharedWire, host: str, port: int, epoch_s: float) -> None:
        self._wire = wire
        self._epoch_s = epoch_s
        self._listening = listening_tcp(host, port)
        self._host, self.port = self._listening.getsockname()
        self._members: list[_Member] = []

    def address(self) -> str:
        return f"socketcand {self._host}:{self.port}, any channel name"

    def poll(self, now_s: float) -> None:
        for client in accept_all(self._listening, len(self._members)):
            client.send(socketcand.GREETING)
            self._members.append(_Member(client, self._wire.join()))
        for member in self._members:
            self._listen_to(member, now_s)
            self._send_frames(member, now_s)
            member.client.flush(now_s)
        self._remove_closed()

    def _listen_to(self, member: _Member, now_s: float) -> None:
        received = member.client.receive()
        if not received:
            return
        # The body of a browser's request may hold valid messages; none of it is obeyed.
        if is_http(member.rest + received):
            member.client.open = False
            return
        try:
            messages, member.rest = socketcand.split(member.rest + received)
        # A client that does not follow the protocol is disconnected.
        except MalformedFrame:
            member.client.open = False
            return
        for words in messages:
            self._obey(member, words, now_s)

    def _obey(self, member: _Member, words: list[str], now_s: float) -> None:
        command = words[0] if words else ""
        if command == "send" and member.is_open:
            self._send(member, words)
        elif command == "open":
            member.is_open = True
            member.client.send(socketcand.OK)
        elif command in {"rawmode", "bcmmode"} and member.is_open:
            # Only raw mode receives frames; `bcmmode` switches them off again.
            member.told_from_s = now_s + FRAME_DELAY_S if command == "rawmode" else NEVER
            member.client.send(socketcand.OK)
        elif command == "echo":
            member.client.send(b"< echo >")
        else:
            member.client.send(socketcand.error("unknown command" if member.is_open else "open a bus first"))

    def _send(self, member: _Member, words: list[str]) -> None:
        try:
            member.end.send(message_of(socketcand.decode_send(words)))
        except MalformedFrame:
            member.client.send(socketcand.error("could not parse send command"))

    def _send_frames(self, member: _Member, now_s: float) -> None:
        # Frames wait at the end of the bus until then.
        if now_s < member.told_from_s < NEVER:
            return
        while (message := member.end.recv(timeout=0)) is not None:
            # The protocol carries neither remote frames nor CAN FD.
            if member.told_from_s < NEVER and is_classic(message) and not message.is_remote_frame:
                member.client.send(socketcand.encode_frame(frame_of(message), self._epoch_s + now_s))

    def _remove_closed(self) -> None:
        for member in [member for member in self._members if not member.client.open]:
            self._members.remove(member)
            self._wire.leave(member.end)
            member.client.close()

    def close(self) -> None:
        for member in self._members:
            member.client.open = False
        self._remove_closed()
        self._listening.close()
