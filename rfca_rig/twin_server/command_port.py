"""TCP port of the Net F/T box's command interface: commands of 20 bytes, one reply each."""

from dataclasses import dataclass

from rfca_rig.codecs.netft_configuration import COMMAND_BYTES
from rfca_rig.twin_server.listening import listening_tcp
from rfca_rig.twin_server.tcp_client import TcpClient, accept_all
from rfca_rig.twins.netft import NetFtBoxTwin


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
