"""Motor conformance tests on the plug-in drive of a rig file and its twin."""

from typing import Any

import can
import pytest

from rfca_rig.clock import Clock
from rfca_rig.contracts.motor import MotorContract
from rfca_rig.description.motor_sections import MotorKeys
from rfca_rig.description.own_devices import twin_of
from rfca_rig.description.rig_file import RigFile
from rfca_rig.drivers.roles import ShaftMotor
from rfca_rig.twins.drive_parts import LoopGains

SILENT_S = 0.3


class TestOurMotor(MotorContract):
    """Runs the tests. A twin may widen tolerances in `tolerances`, if its protocol is coarser than most."""

    @pytest.fixture(autouse=True)
    def _of_the_rig_file(self, described: RigFile) -> None:
        assert isinstance(described.motor, MotorKeys), "[motor] is not of a file of its own"
        self.keys = described.motor
        twin_class = twin_of(self.keys)
        self.TELLS_TEMPERATURE = getattr(twin_class, "tells_temperature", False)
        for name, value in getattr(twin_class, "tolerances", {}).items():
            setattr(self, name, value)

    def driver(self, bus: can.BusABC, clock: Clock) -> ShaftMotor:
        return self.keys.driver(bus, clock, SILENT_S)

    def twin(self, bus: can.BusABC, watchdog_s: float | None) -> Any:
        return twin_of(self.keys)(bus, self.keys, LoopGains(), watchdog_s)

    def leave_stale_set_point(self, bus: can.BusABC) -> None:
        for message in self.twin(bus, None).stale_set_point():
            bus.send(message)

    def fail(self, twin: Any) -> str:
        return str(twin.fail())

    def refuse(self, twin: Any) -> str:
        return str(twin.refuse())
