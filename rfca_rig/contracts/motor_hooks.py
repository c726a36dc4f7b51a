"""What the contract of a motor driver asks of the device's test: how to make the driver and its twin, and how to make it fail."""

from contextlib import AbstractContextManager
from typing import Any

import can

from rfca_rig.clock import Clock
from rfca_rig.contracts.motor_rig import MotorRig, motor_rig
from rfca_rig.contracts.rotor import Rotor
from rfca_rig.drivers.roles import ShaftMotor


class MotorHooks:
    """Inherit, and fill in what raises NotImplementedError; the tolerances are one count of the wire and what the drive's loop leaves."""

    ANGLE_TOLERANCE_RAD = 2e-3
    SPEED_TOLERANCE_RAD_S = 1e-2
    TORQUE_TOLERANCE_Nm = 0.05
    ENABLING_TORQUE_Nm = 0.05  # a loop that is stiff in the angle turns one count into torque
    FOLLOWING_TOLERANCE_RAD = 0.02  # behind a target that moves at 2 rad/s
    TELLS_TEMPERATURE = True

    def driver(self, bus: can.BusABC, clock: Clock) -> ShaftMotor:
        raise NotImplementedError

    def twin(self, bus: can.BusABC, watchdog_s: float | None) -> Any:
        """The other end of the wire; with `watchdog_s` None it runs on for ever, as many drives do."""
        raise NotImplementedError

    def leave_stale_set_point(self, bus: can.BusABC) -> None:
        """Says to the drive, before it is enabled, to be somewhere else and fast."""
        raise NotImplementedError

    def fail(self, twin: Any) -> str:
        """Gives the drive an error of its own; returns the pattern of what must be said: its code, and what that means."""
        raise NotImplementedError

    def refuse(self, twin: Any) -> str:
        """Makes every attempt to enable the drive end in an error of its own; returns the pattern of what must be said."""
        raise NotImplementedError

    def rig(self, rotor: Rotor | None = None, watchdog_s: float | None = 0.1) -> AbstractContextManager[MotorRig]:
        return motor_rig(self.driver, lambda bus: self.twin(bus, watchdog_s), rotor)
