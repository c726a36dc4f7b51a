"""Conformance tests for drivers of shaft motors; each device inherits them and runs them on its own twin.

The test file of a device defines how to create its driver and twin. It also defines how to leave a stale set-point in the drive and how
to make it fail, and adds tests of its special features:

    class TestMyDrive(MotorContract):
        def driver(self, bus, clock): ...
"""

from rfca_rig.contracts.motor_moves import MotorMoves
from rfca_rig.contracts.motor_stops import MotorStops


class MotorContract(MotorMoves, MotorStops):
    """Inherit, and implement the methods of `MotorHooks` that raise NotImplementedError."""
