"""Each named fault, and what the drivers make of it.

Run: python -m tests.twin_server.fault_table prints the table

One second of a turning shaft, then the fault for a second, in simulated time.
"""

from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import dataclass

import numpy as np

from rfca_rig.clock import TwinClock
from rfca_rig.contracts.motor_rig import Rotor
from rfca_rig.devices.netft.codec import RdtCommand, encode_request
from rfca_rig.devices.netft.driver import HttpBox, NetFtSensor
from rfca_rig.devices.netft.ports import BOX_FAULTS, FORCE_FAULTS, HttpPort, TamperedLink
from rfca_rig.devices.netft.section import NetFtSettings
from rfca_rig.devices.netft.twin import NetFtBoxTwin, NetFtTwin, NetFtTwinSettings
from rfca_rig.devices.odrive.driver import OdriveMotor, OdriveSettings
from rfca_rig.devices.odrive.twin import (
    FAULTS,
    OdriveDialect,
    OdriveTwin,
    OdriveTwinSettings,
    odrive_events,
)
from rfca_rig.errors import BadInput, DeviceError
from rfca_rig.twin_server.faults import CAN_FAULTS, FaultPanel, TamperedBus
from rfca_rig.twins.wires import LinkEnd, can_wire, datagram_link
from rfca_rig.twins.world import TwinWorld
from tests.twin_server.polling import polled

TICK_S = 2e-3
SPEED_RAD_S = 1.0
NOTHING = "nothing"
ON_THE_PAGES = frozenset(
    {
        "force-scale",
        "http-busy",
        "box-turned",
        "box-filter",
        "box-pounds",
        "box-axia",
    }
)
CATALOGUE = (*FORCE_FAULTS, *BOX_FAULTS, *CAN_FAULTS, *FAULTS.faults)


@dataclass
class FaultyRig:
    clock: TwinClock
    motor: OdriveMotor
    sensor: NetFtSensor
    panel: FaultPanel
    events: dict[str, Callable[[], None]]
    link: LinkEnd
    force_rad: list[float]

    def run(self, seconds: float) -> None:
        for _ in range(round(seconds / TICK_S)):
            for name, happen in self.events.items():
                if self.panel.take(name):
                    happen()
            self.motor.command_speed(SPEED_RAD_S)
            self.clock.wait_until(self.clock.now_s() + TICK_S)
            self.sensor.read()
            self.force_rad += self.motor.read().angle_rad.tolist()


def faulty_rig(stack: ExitStack) -> FaultyRig:
    clock = TwinClock()
    panel = FaultPanel(CATALOGUE)
    drivers_end, twins_end = stack.enter_context(can_wire())
    here, there = datagram_link()
    bus = TamperedBus(twins_end, panel, OdriveDialect())
    stack.callback(bus.shutdown)
    drive = OdriveTwin(bus, OdriveTwinSettings())
    box = NetFtTwin(TamperedLink(there, panel), NetFtTwinSettings(), np.random.default_rng(1))
    clock.carry(TwinWorld(Rotor(), drive, box).process)
    motor = OdriveMotor(drivers_end, clock, OdriveSettings(node_id=0))
    sensor = NetFtSensor(here, clock, NetFtSettings())
    return FaultyRig(clock, motor, sensor, panel, dict(odrive_events(drive)), here, [])


def noticed(name: str) -> str:
    """What the drivers say of a fault."""
    with ExitStack() as stack:
        rig = faulty_rig(stack)
        rig.motor.enable()
        rig.sensor.start()
        rig.run(1.0)
        assert said(rig) == NOTHING, said(rig)
        rig.panel.switch_on(name)
        if name == "bias-stops-stream":
            rig.link.send(encode_request(RdtCommand.SET_BIAS))
        try:
            rig.run(1.0)
        except DeviceError as error:
            return f"raises: {error}"
        return said(rig)


def noticed_at_start(name: str) -> str:
    """What the driver says where it asks the box's pages for their scale before it starts."""
    here, there = datagram_link()
    panel = FaultPanel(CATALOGUE)
    settings = NetFtTwinSettings()
    box = NetFtBoxTwin(NetFtTwin(there, settings, np.random.default_rng(1)))
    pages = HttpPort(box, panel, "127.0.0.1", 0)
    sensor = NetFtSensor(here, TwinClock(), NetFtSettings(), HttpBox("127.0.0.1", pages.port))
    with polled(pages):
        sensor.start()
        panel.switch_on(name)
        try:
            warnings = sensor.check_configuration()
            sensor.start()
        except (BadInput, DeviceError) as error:
            return f"at the next start: {error}"
    return "; ".join(warnings) or NOTHING


def said(rig: FaultyRig) -> str:
    health = rig.sensor.health()
    status = rig.motor.status()
    counts = {
        "lost": health.lost,
        "twice": health.duplicate,
        "out of order": health.out_of_order,
        "malformed": health.malformed,
        "faulty status": health.faulty_status,
    }
    words = [f"{count} {name}" for name, count in counts.items() if count] + health.notes
    words += [f"motor: {status.fault}"] if status.fault else []
    jumps = np.abs(np.diff(rig.force_rad))
    words += [f"angle jumps by {jumps.max():.2f} rad"] if len(jumps) and jumps.max() > 0.5 else []
    return "; ".join(words) or NOTHING


def told(name: str) -> str:
    if name in ON_THE_PAGES:
        return noticed_at_start(name)
    return noticed(name)


def table() -> str:
    """Markdown."""
    rows = [f"| {fault.name} | {fault.meaning} | {told(fault.name)} |" for fault in CATALOGUE]
    return "\n".join(["| fault | what happens | what the drivers say |", "|---|---|---|", *rows])


if __name__ == "__main__":
    print(table())
