"""TCP port for text commands to the running server, always on the loopback address only."""

from collections.abc import Callable
from dataclasses import dataclass

from rfca_rig.errors import BadInput
from rfca_rig.twin_server.faults import FaultPanel
from rfca_rig.twin_server.tcp import LOOPBACK, TcpClient, accept_all, is_http, listening_tcp

LONGEST_LINE = 1024
VERBS = "on NAME, off NAME, off all, faults, status, height MM"


@dataclass
class _Connection:
    client: TcpClient
    rest: bytes = b""


class ControlPort:
    """Answers each line with one or more lines, the last of which begins with `ok` or `error`.

    `set_height` takes metres; `status` returns the server's state in one line.
    """

    def __init__(self, panel: FaultPanel, port: int, set_height: Callable[[float], None], status: Callable[[], str]) -> None:
        self._panel = panel
        self._set_height = set_height
        self._status = status
        # Faults and heights are for the local user, even if the device ports are open to the network.
        self._listening = listening_tcp(LOOPBACK, port)
        self.port = int(self._listening.getsockname()[1])
        self._connections: list[_Connection] = []

    def address(self) -> str:
        return f"control lines on TCP {LOOPBACK}:{self.port} ({VERBS})"

    def poll(self, now_s: float) -> None:
        self._connections += [_Connection(client) for client in accept_all(self._listening, len(self._connections))]
        for connection in self._connections:
            self._listen(connection)
            connection.client.flush(now_s)
        for connection in [connection for connection in self._connections if not connection.client.open]:
            self._connections.remove(connection)
            connection.client.close()

    def _listen(self, connection: _Connection) -> None:
        received = connection.rest + connection.client.receive()
        # The body of a browser's request may hold valid commands; none of it is obeyed.
        if is_http(received):
            connection.client.open = False
            return
        *lines, connection.rest = received.split(b"\n")
        for line in lines:
            answer = self._answer(line.decode("ascii", "replace").split())
            connection.client.send("".join(f"{reply}\n" for reply in answer).encode("ascii", "replace"))
        # A client that never ends its line must not fill the memory.
        if len(connection.rest) > LONGEST_LINE:
            connection.client.open = False

    def _answer(self, words: list[str]) -> list[str]:
        try:
            return [*self._execute(words), "ok"] if words else []
        except BadInput as error:
            return [f"error {error}"]

    def _execute(self, words: list[str]) -> list[str]:
        match words:
            case ["on", name]:
                self._panel.switch_on(name)
            case ["off", "all"]:
                self._panel.switch_all_off()
            case ["off", name]:
                self._panel.switch_off(name)
            case ["faults"]:
                return self._panel.lines()
            case ["status"]:
                return [self._status()]
            case ["height", height_mm]:
                self._set_height(_height_m(height_mm))
            case _:
                raise BadInput(f"cannot read {' '.join(words)[:60]!r}; the commands are {VERBS}")
        return []

    def close(self) -> None:
        for connection in self._connections:
            connection.client.close()
        self._connections.clear()
        self._listening.close()


def _height_m(height_mm: str) -> float:
    try:
        height = float(height_mm)
    except ValueError:
        height = float("nan")
    if not 0.0 < height < 1000.0:
        raise BadInput(f"height {height_mm[:20]} is not one in millimetres, above 0 and below 1000")
    return 1e-3 * height
