"""Test rig for one motor driver: driver, twin, and a rotor with known dynamics; no sensor."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Any

import can
import numpy as np

from rfca_rig.clock import Clock, TwinClock
from rfca_rig.contracts.rotor import Rotor
from rfca_rig.drivers.roles import ShaftMotor, ShaftSamples
from rfca_rig.twins.netft import NetFtTwin, NetFtTwinSettings
from rfca_rig.twins.wires import CanEnd, can_wire, datagram_link
from rfca_rig.twins.world import TwinWorld

TICK_S = 2e-3


@dataclass
class MotorRig:
    """A motor driver on its twin. `wire` is the driver's end of the bus, `observer` a third one.

    `turned` lists time, true angle and torque of the rotor at each tick.
    """

    clock: TwinClock
    rotor: Rotor
    motor: ShaftMotor
    twin: Any
    wire: CanEnd
    observer: can.BusABC
    turned: list[tuple[float, float, float]] = field(default_factory=list)

    def run(
        self, seconds: float, speed_rad_s: float | None = None, angle_rad: float | None = None, deaf: bool = False, tick_s: float = TICK_S
    ) -> ShaftSamples:
        """Runs ticks like a control loop with the given command; returns all samples (m,). With `deaf` the drive's frames are lost."""
        read = [self.motor.read()]
        for _ in range(round(seconds / tick_s)):
            if speed_rad_s is not None:
                self.motor.command_speed(speed_rad_s)
            if angle_rad is not None:
                self.motor.command_angle(angle_rad)
            self.tick(deaf, tick_s)
            read.append(self.motor.read())
        return concatenate_samples(read)

    def tick(self, deaf: bool = False, tick_s: float = TICK_S) -> None:
        """Advances time by one tick and notes the true motion."""
        self.clock.wait_until(self.clock.now_s() + tick_s)
        if deaf:
            drain(self.wire)
        self.turned.append((self.clock.now_s(), self.rotor.angle_rad, self.rotor.torque_Nm))


def concatenate_samples(blocks: list[ShaftSamples]) -> ShaftSamples:
    """Concatenates blocks of samples, columns (m,)."""
    return ShaftSamples(*(np.concatenate([vars(block)[name] for block in blocks]) for name in vars(blocks[0])))


def drain(bus: can.BusABC) -> list[can.Message]:
    """Receives all frames that the bus holds."""
    return list(iter(lambda: bus.recv(timeout=0), None))


@contextmanager
def motor_rig(
    driver: Callable[[can.BusABC, Clock], ShaftMotor], twin: Callable[[can.BusABC], Any], rotor: Rotor | None = None
) -> Iterator[MotorRig]:
    rotor, clock = rotor or Rotor(), TwinClock()
    # The third end lets a test observe the bus, and act as another program on it.
    with can_wire(ends=3) as (drivers_end, twins_end, observer):
        drive = twin(twins_end)
        # A world needs a sensor; this one has no listener.
        sensor = NetFtTwin(datagram_link()[1], NetFtTwinSettings(), np.random.default_rng(1))
        clock.carry(TwinWorld(rotor, drive, sensor).process)
        yield MotorRig(clock, rotor, driver(drivers_end, clock), drive, drivers_end, observer)
