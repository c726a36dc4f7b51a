"""What every driver of a shaft motor must do, written once; each device inherits it and runs it on its own twin.

A device's test file says how to make its driver and its twin, how to leave a stale set-point in the drive and how to make it
fail, and adds tests of what only it does:

    class TestMyDrive(MotorContract):
        def driver(self, bus, clock): ...
"""

from rfca_rig.contracts.motor_moves import MotorMoves
from rfca_rig.contracts.motor_stops import MotorStops


class MotorContract(MotorMoves, MotorStops):
    """Inherit, and fill in what `MotorHooks` raises NotImplementedError for."""
