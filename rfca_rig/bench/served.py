"""A twin rig behind network sockets and serial lines, run in real time by one loop in one
thread.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from functools import partial

from rfca_rig.bench.factory import make_twins
from rfca_rig.bench.fault_injection import drive_faults_of, faults_of_served_rig
from rfca_rig.clock import Clock
from rfca_rig.description.rig_file import RigFile
from rfca_rig.devices import find_sensor
from rfca_rig.errors import BadInput
from rfca_rig.twin_server.can_ports import FdcanusbPort, SharedWire, SlcanPort, SocketcandPort
from rfca_rig.twin_server.faults import (
    ControlPort,
    FaultEvent,
    FaultPanel,
    FaultSchedule,
    TamperedBus,
    refuse_line,
)
from rfca_rig.twin_server.open_ports import Openings, OpenPorts, Port

# Period of the loop, and longest step of the twins after a delay, in s.
PERIOD_S = 1e-3
LONGEST_LEAP_S = 0.05

# The first step of the simulation, which may compile the model.
WARM_UP_S = 2e-3


class RealTimeLoop:
    """Every millisecond the ports receive, `process` advances the twins to now, starting at 0, and
    the ports send.

    If the machine is too slow, the twins lose time instead of falling further behind. A step is at
    most 50 ms, and the excess is added to `slipped_s`. To their clients they then seem slow, like a
    device with a bad crystal.
    """

    def __init__(self, process: Callable[[float], None], clock: Clock) -> None:
        self._process = process
        self._clock = clock
        self._twins_s = 0.0
        self.slipped_s = 0.0

    def status(self) -> str:
        """State of the loop in one line."""
        return (
            f"running for {self._twins_s:.2f} s of the twins' time, {self.slipped_s:.2f} s "
            "behind the clock"
        )

    def run(self, ports: Sequence[Port], step: Callable[[float], None], seconds: float) -> None:
        """Runs for `seconds`; call it once only. `step(running_s)` is called in every cycle, and
        may end the loop by raising.
        """
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


class ServedRig:
    """A twin rig, open to clients while `serve` runs; `reached` has its addresses."""

    def __init__(
        self,
        events: Mapping[str, Callable[[], None]],
        panel: FaultPanel,
        loop: RealTimeLoop,
        reached: OpenPorts,
    ) -> None:
        self._events = events
        self._panel = panel
        self._loop = loop
        self.reached = reached

    def serve(
        self, orders: Sequence[FaultEvent], seconds: float, switched: Callable[[FaultEvent], None]
    ) -> None:
        """Runs for that long; `switched` is called with every order of the schedule as it is
        carried out.

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
        raise BadInput(
            f"{rig.rig.title}: only a rig of kind 'twin' with a [twin] section can be served"
        )
    panel = FaultPanel(faults_of_served_rig(rig))
    wire = SharedWire("twin CAN wire")
    sensor = rig.force_sensor
    make = find_sensor(sensor.device)
    sensor_wire = make.find_wire()
    if sensor_wire is None:
        raise BadInput(
            f"{rig.rig.title}: a {sensor.device} has no wire that others could read; it "
            "works in this process only"
        )
    with ExitStack() as stack:
        reached = OpenPorts(openings, stack)
        # Ports first: an occupied one must be found before anything is computed.
        put_on_ports = sensor_wire.open(sensor, panel, reached)
        socketcand = SocketcandPort(
            wire, openings.host, openings.can_port, clock.start_time().timestamp()
        )
        reached.add(socketcand, can_port=socketcand.port)
        if openings.slcan:
            slcan = SlcanPort(wire)
            reached.add(slcan, slcan=slcan.path)
        if rig.motor.fd_bitrate is not None:
            # A port for CAN FD frames, which the other ports cannot carry.
            rates = {
                "can.bitrate": rig.motor.bitrate,
                "can.fd_bitrate": rig.motor.fd_bitrate,
            }
            fdcanusb = FdcanusbPort(wire, rates)
            reached.add(fdcanusb, fdcanusb=fdcanusb.path)
        bus = TamperedBus(wire.join(), panel, drive_faults_of(rig).dialect)
        stack.callback(bus.shutdown)
        twins = make_twins(rig, rig.twin, seed, bus, put_on_ports, panel, openings.has_new_drive)
        twins.plant.set_height(openings.height_m)
        # The first step may take seconds to compile the model; clients never wait for it.
        twins.world.process(WARM_UP_S)
        # The world's clock is ahead by the warm-up step, so every later time is shifted by it.
        loop = RealTimeLoop(lambda to_s: twins.world.process(WARM_UP_S + to_s), clock)
        # On this machine only (see `Openings`): its lines switch faults.
        below_m = rig.sensor.below_shaft_mm / 1e3
        control = ControlPort(
            panel,
            openings.control_port,
            twins.plant.set_height,
            loop.status,
            lambda force_N, lever_m: twins.load.push(force_N, below_m, lever_m),
            getattr(twins.motor, "type_line", refuse_line),
            partial(setattr, twins.world, "held_rad"),
        )
        reached.add(control, control_port=control.port)
        yield ServedRig(drive_faults_of(rig).events(twins.motor), panel, loop, reached)
