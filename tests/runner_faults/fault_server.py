"""The twin server, in which the causes of the fault table can be brought about.

Run: python -m tests.runner_faults.fault_server, as `rfca-rig`

It takes the words of `rfca-rig`, here `twin serve`. Three more lines work on its control port.
`cause NAME` brings about a cause that acts on the drive, the shaft, the sensor or the bus, by the
same function as in simulated time; the answer is when it began. `heal` takes it back, unless it is
in PERMANENT. `torque` tells when the motor last gave torque, whatever the drive reports. Times are
those of the system's monotonic clock, which all processes share.
"""

import sys
import time
from collections.abc import Callable
from dataclasses import dataclass
from types import SimpleNamespace
from typing import Any
from unittest import mock

import can
import numpy as np

from rfca_rig.bench import served
from rfca_rig.bench.factory import Twins, make_twins
from rfca_rig.cli.main import run
from rfca_rig.clock import WallClock
from rfca_rig.devices.netft import ports
from rfca_rig.twin_server.can_ports import SharedWire
from rfca_rig.twin_server.faults import ControlPort, FaultPanel
from rfca_rig.twins.world import ShaftDrive, TwinWorld
from tests.runner_faults.breakable import RunawayDrive
from tests.runner_faults.causes import CAUSES
from tests.runner_faults.rig import TRUE, box_settings
from tests.runner_faults.truth import Truth

FAULT_SERVER = (sys.executable, "-m", "tests.runner_faults.fault_server")
# After these the drive has another zero, is hot, or reports nothing, or the leg may lie on the
# floor: the next try needs a new server.
PERMANENT = frozenset(
    {
        "drive-restart",
        "drive-hot",
        "encoder-frozen",
        "encoder-silent",
        "encoder-silent-held",
        "runaway",
    }
)


class AlterableBus(can.BusABC):
    """The drive's end of the bus; `alter` does to a frame of the drive whatever it wants, and
    None takes it away.
    """

    def __init__(self, end: can.BusABC) -> None:
        super().__init__(channel=end.channel_info)
        self.channel_info = end.channel_info
        self._end = end
        self.alter: Callable[[can.Message], can.Message | None] | None = None

    def send(self, msg: can.Message, timeout: float | None = None) -> None:
        altered = msg if self.alter is None else self.alter(msg)
        if altered is not None:
            self._end.send(altered, timeout)

    def _recv_internal(self, timeout: float | None) -> tuple[can.Message | None, bool]:
        return self._end.recv(timeout), False


class AlterableLink(ports.TamperedLink):
    """The box's end of its network; `alter` does to the datagrams whatever it wants."""

    alter: Callable[[list[bytes]], list[bytes]] | None = None

    def send(self, datagram: bytes) -> None:
        for altered in [datagram] if self.alter is None else self.alter([datagram]):
            super().send(altered)


@dataclass
class TimedTruth(Truth):
    """The true motion of the shaft, and when the motor last gave torque."""

    torque_s: float = 0.0

    def advance(self, to_s: float, drive: ShaftDrive, force_times_s: np.ndarray) -> np.ndarray:
        wrench = super().advance(to_s, drive, force_times_s)
        # Only times are asked for, and a server runs for long.
        self.moments.clear()
        if drive != ShaftDrive():
            self.torque_s = time.monotonic()
        return wrench


class ServedTwins:
    """What a cause may lay hands on, by the names that a `FaultyRig` has for it."""

    def __init__(self) -> None:
        self.clock = WallClock()
        self.sensor = SimpleNamespace(scale=lambda: SimpleNamespace(rate_Hz=7000.0))
        self.wire: SharedWire | None = None
        self.link: AlterableLink | None = None
        self.panel: FaultPanel | None = None

    def make_wire(self, name: str) -> SharedWire:
        self.wire = SharedWire(name)
        return self.wire

    def make_link(self, link: Any, panel: FaultPanel) -> AlterableLink:
        self.link = AlterableLink(link, panel)
        self.panel = panel
        return self.link

    def make_twins(
        self, rig: Any, twin: Any, seed: int, bus: can.BusABC, put_on_ports: Any, is_new: bool
    ) -> Twins:
        self.bus = AlterableBus(bus)
        twins = make_twins(rig, twin, seed, self.bus, put_on_ports, is_new)
        self.drive = twins.motor
        self.truth = TimedTruth(twins.plant)
        self.runaway = RunawayDrive(twins.motor)
        # The range of the simulated run: the served sensor's own ends a little above the limit of
        # the moment.
        twins.sensor._full_scale = np.array(box_settings(TRUE).full_scale)
        motor = twins.motor
        self._healthy = motor._settings, motor._loop, motor._watchdog_s, motor._node
        self.events = dict(served.drive_faults_of(rig).events(twins.motor))
        return Twins(
            self.truth, twins.motor, twins.sensor, TwinWorld(self.truth, self.runaway, twins.sensor)
        )

    @property
    def observer(self) -> can.BusABC:
        """Another node on the bus."""
        return self.wire.join()

    def event(self, name: str) -> None:
        """A fault of the twin's own catalogue."""
        if name in self.events:
            self.events[name]()
        else:
            self.panel.switch_on(name)

    def heal(self) -> None:
        self.bus.alter = self.link.alter = None
        self.panel.switch_all_off()
        self.truth.blocked_rad = None
        self.truth.loose = False
        self.truth.pull = np.zeros(6)
        self.runaway.away_Nm = None
        drive = self.drive
        drive._settings, drive._loop, drive._watchdog_s, drive._node = self._healthy


def main() -> None:
    twins = ServedTwins()

    class FaultControlPort(ControlPort):
        def _execute(self, words: list[str]) -> list[str]:
            match words:
                case ["cause", name]:
                    begun_s = time.monotonic()
                    CAUSES[name].begin(twins)
                    return [repr(begun_s)]
                case ["heal"]:
                    twins.heal()
                    return []
                case ["torque"]:
                    return [repr(twins.truth.torque_s)]
            return super()._execute(words)

    with (
        mock.patch.object(served, "make_twins", twins.make_twins),
        mock.patch.object(served, "SharedWire", twins.make_wire),
        mock.patch.object(served, "ControlPort", FaultControlPort),
        mock.patch.object(ports, "TamperedLink", twins.make_link),
    ):
        run()


if __name__ == "__main__":
    main()
