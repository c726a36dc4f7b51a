"""Lines of text by which a person or a script commands the running server: on this machine only, whatever else is open."""

from collections.abc import Callable
from dataclasses import dataclass

from rfca_rig.errors import BadInput
from rfca_rig.twin_server.faults import FaultPanel
from rfca_rig.twin_server.listening import LOOPBACK, listening_tcp
from rfca_rig.twin_server.tcp_client import TcpClient, accept_all

LONGEST_LINE = 1024
VERBS = "on NAME, off NAME, off all, faults, status, height MM"


@dataclass
class _Talk:
    client: TcpClient
    rest: bytes = b""


class ControlPort:
    """Answers each line with lines of its own, the last of which begins with `ok` or `error`.

    `set_height` takes metres; `status` gives one line on how the server is.
    """

    def __init__(self, panel: FaultPanel, port: int, set_height: Callable[[float], None], status: Callable[[], str]) -> None:
        self._panel = panel
        self._set_height = set_height
        self._status = status
        self._listening = listening_tcp(LOOPBACK, port)
        self.port = int(self._listening.getsockname()[1])
        self._talks: list[_Talk] = []

    def address(self) -> str:
        return f"control lines on TCP {LOOPBACK}:{self.port} ({VERBS})"

    def poll(self, now_s: float) -> None:  # noqa: ARG002 (commands act at once)
        self._talks += [_Talk(client) for client in accept_all(self._listening)]
        for talk in self._talks:
            self._listen(talk)
            talk.client.flush()
        for talk in [talk for talk in self._talks if not talk.client.open]:
            self._talks.remove(talk)
            talk.client.close()

    def _listen(self, talk: _Talk) -> None:
        *lines, talk.rest = (talk.rest + talk.client.receive()).split(b"\n")
        for line in lines:
            answer = self._answer(line.decode("ascii", "replace").split())
            talk.client.send("".join(f"{said}\n" for said in answer).encode("ascii", "replace"))
        if len(talk.rest) > LONGEST_LINE:
            talk.client.open = False

    def _answer(self, words: list[str]) -> list[str]:
        try:
            return [*self._obeyed(words), "ok"] if words else []
        except BadInput as error:
            return [f"error {error}"]

    def _obeyed(self, words: list[str]) -> list[str]:
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
        for talk in self._talks:
            talk.client.close()
        self._talks.clear()
        self._listening.close()


def _height_m(height_mm: str) -> float:
    try:
        height = float(height_mm)
    except ValueError:
        height = float("nan")
    if not 0.0 < height < 1000.0:
        raise BadInput(f"height {height_mm[:20]} is not one in millimetres, above 0 and below 1000")
    return 1e-3 * height
