"""A twin rig whose wires end in sockets: put together from a rig file, for a real clock to carry along."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager

from rfca_rig.bench.factory import Twins, make_twins
from rfca_rig.bench.fault_injection import dialect_of, events_of, served_faults_of
from rfca_rig.bench.openings import Openings, Reached
from rfca_rig.bench.served_devices import ServedSensor
from rfca_rig.clock import Clock
from rfca_rig.description.rig_file import RigFile
from rfca_rig.errors import BadInput
from rfca_rig.twin_server.control_port import ControlPort
from rfca_rig.twin_server.fault_schedule import Agenda, Switching
from rfca_rig.twin_server.faults import FaultPanel
from rfca_rig.twin_server.fdcanusb_port import FdcanusbPort
from rfca_rig.twin_server.real_time import RealTimeLoop
from rfca_rig.twin_server.shared_wire import SharedWire
from rfca_rig.twin_server.slcan_port import SlcanPort
from rfca_rig.twin_server.socketcand_port import SocketcandPort
from rfca_rig.twin_server.tampered_bus import TamperedBus

WARM_UP_S = 2e-3


class ServedRig:
    """A twin rig, open to clients while `serve` runs; `reached` says where."""

    def __init__(self, events: Mapping[str, Callable[[], None]], panel: FaultPanel, loop: RealTimeLoop, reached: Reached) -> None:
        self._events = events
        self._panel = panel
        self._loop = loop
        self.reached = reached

    def serve(self, orders: Sequence[Switching], seconds: float, switched: Callable[[Switching], None]) -> None:
        """Goes on for that long; `switched` hears of every order of the agenda as it is carried out.

        Raises BadInput at once for an order that names no fault.
        """
        agenda = Agenda(orders, self._panel)

        def step(running_s: float) -> None:
            for order in agenda.pass_to(running_s):
                switched(order)
            self._panel.let_happen(self._events)

        self._loop.run(self.reached.ports, step, seconds)

    def status(self) -> str:
        return self._loop.status()


@contextmanager
def open_served(rig: RigFile, seed: int, openings: Openings, clock: Clock) -> Iterator[ServedRig]:
    """The rig with its ports open for the length of the block.

    Raises BadInput for a rig without twins, and for ports that cannot be had.
    """
    if rig.twin is None or rig.is_real:
        raise BadInput(f"{rig.rig.title}: only a rig of kind 'twin' with a [twin] section can be served")
    panel, wire, reached = FaultPanel(served_faults_of(rig)), SharedWire("twin CAN wire"), Reached()
    with ExitStack() as stack:
        sensor = ServedSensor(rig, openings, panel, reached, stack)
        _open_can(wire, openings, clock, reached, stack)
        if rig.motor.fd_bitrate is not None:
            _open_can_fd(wire, reached, stack)
        bus = TamperedBus(wire.join(), panel, dialect_of(rig))
        stack.callback(bus.shutdown)
        twins = make_twins(rig, rig.twin, seed, bus, sensor.twin)
        twins.plant.set_height(openings.height_m)
        loop = _warm_loop(twins, clock)
        control = ControlPort(panel, openings.control_port, twins.plant.set_height, loop.status)
        stack.callback(control.close)
        reached.add(control, control_port=control.port)
        yield ServedRig(events_of(twins.motor), panel, loop, reached)


def _open_can(wire: SharedWire, openings: Openings, clock: Clock, reached: Reached, stack: ExitStack) -> None:
    socketcand = SocketcandPort(wire, openings.host, openings.can_port, clock.started_at().timestamp())
    stack.callback(socketcand.close)
    reached.add(socketcand, can_port=socketcand.port)
    if openings.slcan:
        slcan = SlcanPort(wire)
        stack.callback(slcan.close)
        reached.add(slcan, slcan=slcan.path)


def _open_can_fd(wire: SharedWire, reached: Reached, stack: ExitStack) -> None:
    """What the other openings of the bus cannot carry."""
    fdcanusb = FdcanusbPort(wire)
    stack.callback(fdcanusb.close)
    reached.add(fdcanusb, fdcanusb=fdcanusb.path)


def _warm_loop(twins: Twins, clock: Clock) -> RealTimeLoop:
    """The first step may compile the model, which takes seconds; clients do not see it."""
    twins.world.process(WARM_UP_S)
    return RealTimeLoop(lambda to_s: twins.world.process(WARM_UP_S + to_s), clock)
