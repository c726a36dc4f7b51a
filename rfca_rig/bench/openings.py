"""Network and serial addresses of a served rig: as requested, and as opened."""

from dataclasses import dataclass

from rfca_rig.twin_server.listening import LOOPBACK
from rfca_rig.twin_server.port import Port


@dataclass(frozen=True)
class Openings:
    """Requested ports; 0 is any that is free. `control_port` is always on this machine only."""

    host: str = LOOPBACK
    rdt_port: int = 0
    http_port: int = 0
    command_port: int = 0
    can_port: int = 0
    control_port: int = 0
    slcan: bool = False
    height_m: float = 0.25


class OpenPorts:
    """The opened ones: `ports` to be polled, `addresses` for people, `names` for programs."""

    def __init__(self) -> None:
        self.ports: list[Port] = []
        self.addresses: list[str] = []
        self.names: dict[str, int | str] = {}

    def note(self, address: str, **names: int | str) -> None:
        """Adds an address that its twin reads and writes by itself."""
        self.addresses.append(address)
        self.names.update(names)

    def add(self, port: Port, **names: int | str) -> None:
        """Adds a port that must be polled."""
        self.ports.append(port)
        self.note(port.address(), **names)
