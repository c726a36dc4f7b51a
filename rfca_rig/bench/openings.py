"""Where a served rig is to be reached, as ordered, and as it came out."""

from dataclasses import dataclass

from rfca_rig.twin_server.listening import LOOPBACK
from rfca_rig.twin_server.port import Port


@dataclass(frozen=True)
class Openings:
    """A port of 0 is any that is free; `control_port` is always on this machine only."""

    host: str = LOOPBACK
    rdt_port: int = 0
    http_port: int = 0
    command_port: int = 0
    can_port: int = 0
    control_port: int = 0
    slcan: bool = False
    height_m: float = 0.25


class Reached:
    """The openings there are: `ports` to be polled, `addresses` for people, `names` for programs."""

    def __init__(self) -> None:
        self.ports: list[Port] = []
        self.addresses: list[str] = []
        self.names: dict[str, int | str] = {}

    def note(self, address: str, **names: int | str) -> None:
        """An opening that its twin itself reads and writes."""
        self.addresses.append(address)
        self.names.update(names)

    def add(self, port: Port, **names: int | str) -> None:
        """An opening that is to be polled."""
        self.ports.append(port)
        self.note(port.address(), **names)
