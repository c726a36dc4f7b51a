"""The Net F/T box's command interface: 20 bytes in, one reply out, over and over."""

from dataclasses import dataclass

from rfca_rig.codecs.netft_commands import COMMAND_BYTES
from rfca_rig.twin_server.listening import listening_tcp
from rfca_rig.twin_server.tcp_client import TcpClient, accept_all
from rfca_rig.twins.netft_box import NetFtBoxTwin


@dataclass
class _Talk:
    client: TcpClient
    rest: bytes = b""


class CommandPort:
    """Any number of clients at once. Commands that write are not answered."""

    def __init__(self, box: NetFtBoxTwin, host: str, port: int) -> None:
        self._box = box
        self._listening = listening_tcp(host, port)
        self._host, self.port = self._listening.getsockname()
        self._talks: list[_Talk] = []

    def address(self) -> str:
        return f"Net F/T commands on TCP {self._host}:{self.port}"

    def poll(self, now_s: float) -> None:  # noqa: ARG002 (answers at once)
        self._talks += [_Talk(client) for client in accept_all(self._listening)]
        for talk in self._talks:
            talk.rest += talk.client.receive()
            while len(talk.rest) >= COMMAND_BYTES:
                talk.client.send(self._box.answer(talk.rest[:COMMAND_BYTES]))
                talk.rest = talk.rest[COMMAND_BYTES:]
            talk.client.flush()
        for talk in [talk for talk in self._talks if talk.client.done]:
            self._talks.remove(talk)
            talk.client.close()

    def close(self) -> None:
        for talk in self._talks:
            talk.client.close()
        self._talks.clear()
        self._listening.close()
