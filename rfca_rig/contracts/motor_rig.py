"""Test rig for one motor driver: driver, twin, and a rotor with a known motion; no sensor.

The rotor has inertia and a constant load, and gives a wrench that is a known function of time.
`MotorHooks` create driver and twin.
"""

from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass, field
from typing import Any

import can
import numpy as np
from numpy.typing import NDArray

from rfca_rig.clock import Clock, TwinClock
from rfca_rig.drivers.roles import ShaftMotor, ShaftSamples
from rfca_rig.twins.wires import NO_TIMES, CanEnd, can_wire
from rfca_rig.twins.world import ShaftDrive, ShaftState, TwinWorld

Floats = NDArray[np.float64]

TICK_S = 2e-3


@dataclass
class Rotor:
    """Rotor integrated by the implicit midpoint rule at 0.1 ms. The wrench is (1, 2, ... 6) *
    `swing` * sin(2 pi 5 Hz t).
    """

    inertia_kg_m2: float = 0.02
    load_Nm: float = 0.0
    angle_rad: float = 0.3
    speed_rad_s: float = 0.0
    swing: float = 1.0
    now_s: float = 0.0
    torque_Nm: float = 0.0
    drives: list[tuple[float, ShaftDrive]] = field(default_factory=list)

    def advance(self, to_s: float, drive: ShaftDrive, force_times_s: Floats) -> Floats:
        """Advances to `to_s` under `drive`; returns the wrench (m, 6) in N and N m at
        `force_times_s` (m,).
        """
        assert np.all(force_times_s <= to_s)
        assert np.all(force_times_s > self.now_s - 1e-8)
        self.drives.append((to_s, drive))
        steps = max(1, round((to_s - self.now_s) / 1e-4))
        h = (to_s - self.now_s) / steps
        for _ in range(steps):
            self._step(drive, h)
        self.now_s = to_s
        self.torque_Nm = drive.torque_Nm(self.angle_rad, self.speed_rad_s)
        wrench: Floats = (
            self.swing * np.sin(10.0 * np.pi * force_times_s)[:, None] * np.arange(1.0, 7.0)
        )
        return wrench

    def _step(self, drive: ShaftDrive, h: float) -> None:
        # Implicit midpoint for a linear law: the gains act like added inertia, so stiff loops stay
        # stable.
        stiff = (
            self.inertia_kg_m2
            + 0.5 * h * drive.speed_gain_Nm_s_per_rad
            + 0.25 * h * h * drive.angle_gain_Nm_per_rad
        )
        now_Nm = (
            drive.torque_Nm(self.angle_rad + 0.5 * h * self.speed_rad_s, self.speed_rad_s)
            + self.load_Nm
        )
        gained_rad_s = h * now_Nm / stiff
        self.angle_rad += h * (self.speed_rad_s + 0.5 * gained_rad_s)
        self.speed_rad_s += gained_rad_s

    def shaft(self) -> ShaftState:
        return ShaftState(self.angle_rad, self.speed_rad_s, self.torque_Nm)

    def set_height(self, height_m: float) -> None:
        raise AssertionError(f"a rotor has no height to set to {height_m}")


class IdleSensor:
    """A world needs a sensor; of this one nobody wants records."""

    def take_requests(self) -> None:
        """Nothing is requested."""

    def due(self, to_s: float) -> Floats:  # noqa: ARG002 (at no time)
        """No sample times (0,)."""
        return NO_TIMES

    def take_wrench(self, wrench: Floats) -> None:
        """No wrench (0, 6) is taken."""


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
        self,
        seconds: float,
        speed_rad_s: float | None = None,
        angle_rad: float | None = None,
        deaf: bool = False,
        tick_s: float = TICK_S,
    ) -> ShaftSamples:
        """Runs ticks like a control loop with the given command; returns all samples (m,). With
        `deaf` the drive's frames are lost.
        """
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
    columns = {}
    for name in vars(blocks[0]):
        columns[name] = np.concatenate([vars(block)[name] for block in blocks])
    return ShaftSamples(**columns)


def drain(bus: can.BusABC) -> list[can.Message]:
    """Receives all frames that the bus holds."""
    return list(iter(lambda: bus.recv(timeout=0), None))


@contextmanager
def motor_rig(
    driver: Callable[[can.BusABC, Clock], ShaftMotor],
    twin: Callable[[can.BusABC], Any],
    rotor: Rotor | None = None,
) -> Iterator[MotorRig]:
    rotor = rotor or Rotor()
    clock = TwinClock()
    # The third end lets a test observe the bus, and act as another program on it.
    with can_wire(ends=3) as (drivers_end, twins_end, observer):
        drive = twin(twins_end)
        clock.carry(TwinWorld(rotor, drive, IdleSensor()).process)
        yield MotorRig(clock, rotor, driver(drivers_end, clock), drive, drivers_end, observer)


class MotorHooks:
    """Inherit, and implement the methods that raise NotImplementedError.

    The tolerances cover one count of the protocol and the steady-state error of the drive's loop.
    """

    ANGLE_TOLERANCE_RAD = 2e-3
    SPEED_TOLERANCE_RAD_S = 1e-2
    TORQUE_TOLERANCE_Nm = 0.05
    # A stiff angle loop converts one count of the position to this much torque.
    ENABLING_TORQUE_Nm = 0.05
    # Lag behind a target that moves at 2 rad/s.
    FOLLOWING_TOLERANCE_RAD = 0.02
    # Farthest angle of the shaft from which a drive is enabled.
    LARGEST_ANGLE_RAD = 200.0
    TELLS_TEMPERATURE = True

    def driver(self, bus: can.BusABC, clock: Clock) -> ShaftMotor:
        raise NotImplementedError

    def twin(self, bus: can.BusABC, watchdog_s: float | None) -> Any:
        """Creates the twin; with `watchdog_s` None it has no watchdog, as many drives."""
        raise NotImplementedError

    def leave_stale_set_point(self, bus: can.BusABC) -> None:
        """Sends the drive, before it is enabled, a command to another position at high speed."""
        raise NotImplementedError

    def fail(self, twin: Any) -> str:
        """Puts the drive into an error; returns the regular expression that the driver's text
        must match: code and meaning.
        """
        raise NotImplementedError

    def refuse(self, twin: Any) -> str:
        """Makes every attempt to enable the drive end in an error; returns the regular
        expression of the driver's text.
        """
        raise NotImplementedError

    def rig(
        self, rotor: Rotor | None = None, watchdog_s: float | None = 0.1
    ) -> AbstractContextManager[MotorRig]:
        return motor_rig(self.driver, lambda bus: self.twin(bus, watchdog_s), rotor)
