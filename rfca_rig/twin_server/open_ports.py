"""Ports of the twin server: those that a user asks for, those that were opened, and the wires by
which a sensor's twin is reached.
"""

from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import dataclass
from typing import Any, Protocol

from rfca_rig.twin_server.faults import Fault, FaultPanel
from rfca_rig.twin_server.tcp import LOOPBACK
from rfca_rig.twins.wires import serial_line
from rfca_rig.twins.world import SensorTwin

# Makes the `SensorTwin` of the make on its end of the wire; the wire of a make may need more of it.
TwinMaker = Callable[[Any], Any]


class Port(Protocol):
    """A port to the outside. It never waits; the server polls it before and after each step of
    the twins.
    """

    def address(self) -> str:
        """Address of the port, as shown to the user."""
        ...

    def poll(self, now_s: float) -> None:
        """Receives what has arrived, sends what is queued. `now_s` is the server's clock."""
        ...

    def close(self) -> None:
        """Closes the port. May be called any number of times."""
        ...


@dataclass(frozen=True)
class Openings:
    """Requested ports; 0 is any that is free. `control_port` is always on this machine only.

    `has_new_drive`: the drive is as it leaves its maker.
    """

    host: str = LOOPBACK
    rdt_port: int = 0
    http_port: int = 0
    command_port: int = 0
    can_port: int = 0
    control_port: int = 0
    slcan: bool = False
    height_m: float = 0.25
    has_new_drive: bool = False


class OpenPorts:
    """The opened ones: `ports` to be polled, `addresses` for people, `names` for programs. They
    are closed with the stack.
    """

    def __init__(self, openings: Openings, stack: ExitStack) -> None:
        self.openings = openings
        self._stack = stack
        self.ports: list[Port] = []
        self.addresses: list[str] = []
        self.names: dict[str, int | str] = {}

    def note(self, address: str, close: Callable[[], None], **names: int | str) -> None:
        """Adds an address that its twin reads and writes by itself."""
        self._stack.callback(close)
        self.addresses.append(address)
        self.names.update(names)

    def add(self, port: Port, **names: int | str) -> None:
        """Adds a port that must be polled."""
        self.ports.append(port)
        self.note(port.address(), port.close, **names)


class SensorWire:
    """What is between the driver of a force sensor and its twin, in this process or on ports for
    other programs.

    This one is a serial line. Override both methods for another wire. `faults` can happen to any
    twin on it, `port_faults` only to one on ports.
    """

    faults: tuple[Fault, ...] = ()
    port_faults: tuple[Fault, ...] = ()

    def __init__(self, name: str | None = None) -> None:
        """`name` is the sensor's in the addresses of its ports; without it the section has it."""
        self._name = name

    def connect(
        self,
        keys: Any,  # noqa: ARG002
        make_twin: TwinMaker,
        panel: FaultPanel | None,  # noqa: ARG002
    ) -> tuple[SensorTwin, Any]:
        """The twin in this process, and the way to it for the driver. `panel` switches faults;
        None for a wire without any.
        """
        host, device = serial_line()
        return make_twin(device), host

    def open(
        self,
        keys: Any,
        panel: FaultPanel,  # noqa: ARG002
        ports: OpenPorts,
    ) -> Callable[[TwinMaker], SensorTwin]:
        """Opens the requested ports, so that an occupied one is found before anything is computed;
        here a pseudo terminal.

        Returns a function that puts the twin on them. Raises BadInput for ports that cannot be
        opened.
        """
        # Windows has none.
        from rfca_rig.twin_server.can_ports import PseudoTerminal  # noqa: PLC0415

        line = PseudoTerminal()
        ports.note(
            f"{self._name or keys.title} on serial line {line.path}",
            line.close,
            host=ports.openings.host,
            serial=line.path,
        )
        return lambda make_twin: make_twin(line)


SERIAL = SensorWire()
