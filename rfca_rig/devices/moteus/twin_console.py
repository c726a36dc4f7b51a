"""What a simulated moteus keeps, and its answers to text commands."""

from collections.abc import Callable, Mapping
from math import isfinite

from rfca_rig.devices.moteus.console import (
    FACTORY_SETTINGS,
    INTEGER_SETTINGS,
    format_setting,
    parse_setting,
    split_lines,
)
from rfca_rig.errors import MalformedFrame

# The firmware's buffer for a command, in bytes; a longer one is ignored.
LONGEST_COMMAND = 100
MAX_INTEGER = 0xFFFF


class MoteusConsole:
    """The settings in force, those that outlast a power cycle, and the commands on the stream that
    read and write them.

    `settings` are the saved ones; what they leave out is as from the factory. `stop` is called by
    the command to stop. Of telemetry only its end is known.
    """

    def __init__(self, settings: Mapping[str, float], stop: Callable[[], None]) -> None:
        self._saved = {**FACTORY_SETTINGS, **settings}
        self._in_force = dict(self._saved)
        self._stop = stop
        self._received = b""
        self._answers = b""

    def __getitem__(self, name: str) -> float:
        """The setting that is in force."""
        return self._in_force[name]

    def start(self) -> None:
        """Power on: what was not saved is lost."""
        self._in_force = dict(self._saved)
        self._received = b""
        self._answers = b""

    def reset_to_factory(self) -> None:
        self._saved = dict(FACTORY_SETTINGS)
        self.start()

    def take(self, data: bytes) -> None:
        """Executes the complete lines in what has been received."""
        lines, self._received = split_lines(self._received + data)
        if len(self._received) > LONGEST_COMMAND:
            self._received = b""
        for line in lines:
            self._answers += "".join(f"{text}\r\n" for text in self._execute(line)).encode("latin1")

    def give(self, max_bytes: int) -> bytes:
        """The next bytes of the answers."""
        given = self._answers[:max_bytes]
        self._answers = self._answers[max_bytes:]
        return given

    def _execute(self, line: str) -> list[str]:
        match line.split(" "):
            case ["conf", *words]:
                return self._configure(words)
            case ["d", "stop"]:
                self._stop()
                return ["OK"]
            case ["tel", "stop"]:
                return ["OK"]
            case ["d" | "tel", *_]:
                return ["ERR unknown subcommand"]
        return ["ERR unknown command"]

    def _configure(self, words: list[str]) -> list[str]:
        match words:
            case ["get", name]:
                return [self._get(name)]
            case ["set", name, value]:
                return [self._set(name, value)]
            case ["enumerate"]:
                return [*self._list(""), "OK"]
            case ["enumerate", group]:
                return self._enumerate(group)
            case ["write"]:
                self._saved = dict(self._in_force)
                return ["OK"]
            case ["load"]:
                self._in_force = dict(self._saved)
                return ["OK"]
            case ["default"]:
                self._in_force = dict(FACTORY_SETTINGS)
                return ["OK"]
        return ["ERR unknown subcommand"]

    def _enumerate(self, group: str) -> list[str]:
        if group not in _groups():
            return ["ERR unknown group"]
        return [*self._list(f"{group}."), "OK"]

    def _list(self, prefix: str) -> list[str]:
        return [f"{name} {self._get(name)}" for name in self._in_force if name.startswith(prefix)]

    def _get(self, name: str) -> str:
        if name in self._in_force:
            return format_setting(self._in_force[name])
        return self._refuse(name, "reading")

    def _set(self, name: str, text: str) -> str:
        try:
            value = parse_setting(text)
        except MalformedFrame:
            return "ERR error setting"
        if name not in self._in_force:
            return self._refuse(name, "setting")
        if name in INTEGER_SETTINGS and not (isfinite(value) and 0 <= value <= MAX_INTEGER):
            return "ERR error setting"
        if name in INTEGER_SETTINGS:
            value = int(value)
        self._in_force[name] = value
        return "OK"

    def _refuse(self, name: str, what: str) -> str:
        if name.partition(".")[0] in _groups():
            return f"ERR error {what}"
        return "ERR unknown group"


def _groups() -> set[str]:
    return {name.partition(".")[0] for name in FACTORY_SETTINGS}
