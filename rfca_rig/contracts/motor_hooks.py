"""Hooks of the motor conformance tests: creation of driver and twin, and faults of the drive."""

from contextlib import AbstractContextManager
from typing import Any

import can

from rfca_rig.clock import Clock
from rfca_rig.contracts.motor_rig import MotorRig, motor_rig
from rfca_rig.contracts.rotor import Rotor
from rfca_rig.drivers.roles import ShaftMotor


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
        """Puts the drive into an error; returns the regular expression that the driver's text must match: code and meaning."""
        raise NotImplementedError

    def refuse(self, twin: Any) -> str:
        """Makes every attempt to enable the drive end in an error; returns the regular expression of the driver's text."""
        raise NotImplementedError

    def rig(self, rotor: Rotor | None = None, watchdog_s: float | None = 0.1) -> AbstractContextManager[MotorRig]:
        return motor_rig(self.driver, lambda bus: self.twin(bus, watchdog_s), rotor)
