"""A whole twin rig for tests: clock, wires, twins, world, and the drivers on the other side."""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field

import can
import numpy as np

from rfca_rig.clock import TwinClock
from rfca_rig.contracts.motor_rig import Rotor
from rfca_rig.devices.netft.driver import NetFtSensor
from rfca_rig.devices.netft.section import NetFtSettings
from rfca_rig.devices.netft.twin import NetFtTwin, NetFtTwinSettings
from rfca_rig.devices.odrive.driver import OdriveMotor, OdriveSettings
from rfca_rig.devices.odrive.twin import OdriveTwin, OdriveTwinSettings
from rfca_rig.drivers.roles import ForceSamples, ShaftSamples
from rfca_rig.twins.wires import LinkEnd, can_wire, datagram_link
from rfca_rig.twins.world import TwinWorld

TICK_S = 2e-3


@dataclass
class TwinRig:
    clock: TwinClock
    rotor: Rotor
    motor: OdriveMotor
    sensor: NetFtSensor
    motor_twin: OdriveTwin
    others: list[can.BusABC]
    wire: can.BusABC
    link: "Tampered"

    def run(
        self, seconds: float, speed_rad_s: float | None = None, angle_rad: float | None = None
    ) -> tuple[ShaftSamples, ForceSamples]:
        """Ticks as a control loop does, commanding what is given; returns everything read,
        joined.
        """
        shaft = []
        force = []
        for _ in range(round(seconds / TICK_S)):
            if speed_rad_s is not None:
                self.motor.command_speed(speed_rad_s)
            if angle_rad is not None:
                self.motor.command_angle(angle_rad)
            self.clock.wait_until(self.clock.now_s() + TICK_S)
            shaft.append(self.motor.read())
            force.append(self.sensor.read())
        return _joined(shaft), _joined(force)


def _joined(blocks):
    return type(blocks[0])(
        *(np.concatenate([vars(block)[name] for block in blocks]) for name in vars(blocks[0]))
    )


@dataclass
class Tampered:
    """The driver's end of a link, through which a test can lose, double, reorder and damage what
    comes in.
    """

    end: LinkEnd
    tamper: object = None
    seen: list[bytes] = field(default_factory=list)

    def send(self, datagram: bytes) -> None:
        self.end.send(datagram)

    def receive_all(self) -> list[bytes]:
        received = self.end.receive_all()
        self.seen += received
        if self.tamper:
            return self.tamper(received)
        return received

    def close(self) -> None:
        self.end.close()


@contextmanager
def twin_rig(
    rotor: Rotor | None = None,
    motor: OdriveSettings | None = None,
    motor_twin: OdriveTwinSettings | None = None,
    sensor: NetFtSettings | None = None,
    sensor_twin: NetFtTwinSettings | None = None,
    seed: int = 1,
    observers: int = 0,
) -> Iterator[TwinRig]:
    rotor = rotor or Rotor()
    clock = TwinClock()
    with can_wire(ends=2 + observers) as (drivers_end, twins_end, *others):
        here, there = datagram_link()
        drive = OdriveTwin(twins_end, motor_twin or OdriveTwinSettings())
        world = TwinWorld(
            rotor,
            drive,
            NetFtTwin(there, sensor_twin or NetFtTwinSettings(), np.random.default_rng(seed)),
        )
        clock.carry(world.process)
        link = Tampered(here)
        shaft_motor = OdriveMotor(drivers_end, clock, motor or OdriveSettings(node_id=0))
        force_sensor = NetFtSensor(link, clock, sensor or NetFtSettings())
        yield TwinRig(clock, rotor, shaft_motor, force_sensor, drive, others, drivers_end, link)
