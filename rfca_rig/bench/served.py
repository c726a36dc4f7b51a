"""A twin rig behind network sockets and serial lines, run in real time by one loop in one thread."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

import numpy as np

from rfca_rig.bench.factory import make_twins
from rfca_rig.bench.fault_injection import drive_faults_of, faults_of_served_rig
from rfca_rig.bench.sensors import make_netft_twins, make_own_twin, make_serial_twin
from rfca_rig.clock import Clock
from rfca_rig.description.rig_file import RigFile, TwinSection
from rfca_rig.devices.force_sensor import AtiSerialSection, ForceSensorKeys, NetFtSection
from rfca_rig.errors import BadInput
from rfca_rig.twin_server.can_ports import FdcanusbPort, PseudoTerminal, SharedWire, SlcanPort, SocketcandPort
from rfca_rig.twin_server.faults import ControlPort, FaultEvent, FaultPanel, FaultSchedule, TamperedBus
from rfca_rig.twin_server.netft_ports import CommandPort, HttpPort, TamperedLink, UdpLink
from rfca_rig.twin_server.tcp import LOOPBACK
from rfca_rig.twins.world import SensorTwin

# Period of the loop, and longest step of the twins after a delay, in s.
PERIOD_S = 1e-3
LONGEST_LEAP_S = 0.05

# The first step of the simulation, which may compile the model.
WARM_UP_S = 2e-3


class Port(Protocol):
    """A port to the outside. It never waits; the server polls it before and after each step of the twins."""

    def address(self) -> str:
        """Address of the port, as shown to the user."""
        ...

    def poll(self, now_s: float) -> None:
        """Receives what has arrived, sends what is queued. `now_s` is the server's clock."""
        ...

    def close(self) -> None:
        """Closes the port. May be called any number of times."""
        ...


class RealTimeLoop:
    """Every millisecond the ports receive, `process` advances the twins to now, starting at 0, and the ports send.

    If the machine is too slow, the twins lose time instead of falling further behind. A step is at most 50 ms, and the excess is added
    to `slipped_s`. To their clients they then seem slow, like a device with a bad crystal.
    """

    def __init__(self, process: Callable[[float], None], clock: Clock) -> None:
        self._process = process
        self._clock = clock
        self._twins_s = 0.0
        self.slipped_s = 0.0

    def status(self) -> str:
        """State of the loop in one line."""
        return f"running for {self._twins_s:.2f} s of the twins' time, {self.slipped_s:.2f} s behind the clock"

    def run(self, ports: Sequence[Port], step: Callable[[float], None], seconds: float) -> None:
        """Runs for `seconds`; call it once only. `step(running_s)` is called in every cycle, and may end the loop by raising."""
        began_s = due_s = self._clock.now_s()
        while (now_s := self._clock.now_s()) < began_s + seconds:
            step(now_s - began_s)
            _poll(ports, now_s)
            self._carry(now_s - began_s)
            _poll(ports, now_s)
            # After a delay the loop does not make up the missed cycles.
            due_s = max(due_s + PERIOD_S, self._clock.now_s())
            self._clock.wait_until(due_s)

    def _carry(self, running_s: float) -> None:
        to_s = running_s - self.slipped_s
        late_s = to_s - self._twins_s - LONGEST_LEAP_S
        if late_s > 0.0:
            self.slipped_s += late_s
            to_s -= late_s
        if to_s > self._twins_s:
            self._process(to_s)
            self._twins_s = to_s


def _poll(ports: Sequence[Port], now_s: float) -> None:
    for port in ports:
        port.poll(now_s)


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


class ServedSensor:
    """Opens the force sensor's ports at once, so that an occupied port is found before anything is computed."""

    def __init__(self, rig: RigFile, openings: Openings, panel: FaultPanel, reached: OpenPorts, stack: ExitStack) -> None:
        """Raises BadInput for a sensor without a wire of its own, and for ports that cannot be opened."""
        self._openings, self._panel, self._reached, self._stack = openings, panel, reached, stack
        sensor = rig.force_sensor
        if isinstance(sensor, NetFtSection):
            self._link = UdpLink(openings.host, openings.rdt_port)
            stack.callback(self._link.close)
            reached.note(self._link.address(), host=openings.host, rdt_port=self._link.port)
        elif isinstance(sensor, AtiSerialSection | ForceSensorKeys):
            self._line = PseudoTerminal()
            stack.callback(self._line.close)
            name = "F/T controller" if isinstance(sensor, AtiSerialSection) else Path(sensor.file).name
            reached.note(f"{name} on serial line {self._line.path}", host=openings.host, serial=self._line.path)
        else:
            raise BadInput(f"{rig.rig.title}: a {sensor.device} has no wire that others could read; it works in this process only")

    def twin(self, rig: RigFile, twin: TwinSection, random: np.random.Generator) -> SensorTwin:
        """The sensor's twin on those ports."""
        sensor = rig.force_sensor
        if isinstance(sensor, AtiSerialSection):
            return make_serial_twin(sensor, twin, random, self._line)
        if isinstance(sensor, ForceSensorKeys):
            return make_own_twin(sensor, twin, random, self._line)
        if not isinstance(sensor, NetFtSection):
            raise BadInput(f"{rig.rig.title}: a {sensor.device} cannot be served")
        streaming, box = make_netft_twins(sensor, twin, random, TamperedLink(self._link, self._panel))
        pages = HttpPort(box, self._panel, self._openings.host, self._openings.http_port)
        self._stack.callback(pages.close)
        self._reached.add(pages, http_port=pages.port)
        commands = CommandPort(box, self._openings.host, self._openings.command_port)
        self._stack.callback(commands.close)
        self._reached.add(commands, command_port=commands.port)
        return streaming


class ServedRig:
    """A twin rig, open to clients while `serve` runs; `reached` has its addresses."""

    def __init__(self, events: Mapping[str, Callable[[], None]], panel: FaultPanel, loop: RealTimeLoop, reached: OpenPorts) -> None:
        self._events = events
        self._panel = panel
        self._loop = loop
        self.reached = reached

    def serve(self, orders: Sequence[FaultEvent], seconds: float, switched: Callable[[FaultEvent], None]) -> None:
        """Runs for that long; `switched` is called with every order of the schedule as it is carried out.

        Raises BadInput at once for an order that names no fault.
        """
        agenda = FaultSchedule(orders, self._panel)

        def step(running_s: float) -> None:
            for order in agenda.pass_to(running_s):
                switched(order)
            self._panel.run_pending(self._events)

        self._loop.run(self.reached.ports, step, seconds)

    def status(self) -> str:
        return self._loop.status()


@contextmanager
def open_served(rig: RigFile, seed: int, openings: Openings, clock: Clock) -> Iterator[ServedRig]:
    """The rig with its ports open for the length of the block.

    Raises BadInput for a rig without twins, and for ports that cannot be opened.
    """
    if rig.twin is None or rig.is_real:
        raise BadInput(f"{rig.rig.title}: only a rig of kind 'twin' with a [twin] section can be served")
    panel, wire, reached = FaultPanel(faults_of_served_rig(rig)), SharedWire("twin CAN wire"), OpenPorts()
    with ExitStack() as stack:
        # Ports first: an occupied one must be found before anything is computed.
        sensor = ServedSensor(rig, openings, panel, reached, stack)
        socketcand = SocketcandPort(wire, openings.host, openings.can_port, clock.start_time().timestamp())
        stack.callback(socketcand.close)
        reached.add(socketcand, can_port=socketcand.port)
        if openings.slcan:
            slcan = SlcanPort(wire)
            stack.callback(slcan.close)
            reached.add(slcan, slcan=slcan.path)
        if rig.motor.fd_bitrate is not None:
            # A port for CAN FD frames, which the other ports cannot carry.
            fdcanusb = FdcanusbPort(wire)
            stack.callback(fdcanusb.close)
            reached.add(fdcanusb, fdcanusb=fdcanusb.path)
        bus = TamperedBus(wire.join(), panel, drive_faults_of(rig).dialect)
        stack.callback(bus.shutdown)
        twins = make_twins(rig, rig.twin, seed, bus, sensor.twin)
        twins.plant.set_height(openings.height_m)
        # The first step may take seconds to compile the model; clients never wait for it.
        twins.world.process(WARM_UP_S)
        # The world's clock is ahead by the warm-up step, so every later time is shifted by it.
        loop = RealTimeLoop(lambda to_s: twins.world.process(WARM_UP_S + to_s), clock)
        # On this machine only (see `Openings`): its lines switch faults.
        control = ControlPort(panel, openings.control_port, twins.plant.set_height, loop.status)
        stack.callback(control.close)
        reached.add(control, control_port=control.port)
        yield ServedRig(drive_faults_of(rig).events(twins.motor), panel, loop, reached)
