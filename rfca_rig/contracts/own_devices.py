"""Conformance tests on the plug-in drive and force sensor of a rig file, and their twins.

The module itself is the plug-in of pytest with the option --rig.
"""

import os
import sys
from pathlib import Path
from typing import Any

import can
import numpy as np
import pytest

from rfca_rig.clock import Clock, TwinClock
from rfca_rig.contracts.force_sensor import ForceSensorContract, ForceSensorRig, NoisyPort, constant
from rfca_rig.contracts.motor import MotorContract
from rfca_rig.description.device_sections import ForceSensorKeys, MotorKeys
from rfca_rig.description.own_devices import twin_of
from rfca_rig.description.rig_file import RigFile, read_rig
from rfca_rig.drivers.force_sensors.record_stream import RecordStream
from rfca_rig.drivers.roles import ShaftMotor
from rfca_rig.errors import BadInput
from rfca_rig.twins.drive_parts import LoopGains
from rfca_rig.twins.wires import serial_line

LATENCY_S = 0.02
# Duration of the lost piece of the stream in s.
LOST_S = 0.05
# Relative resolution of a single-precision value, as share of the range.
SINGLE_PRECISION_RESOLUTION = 2e-7

SILENT_S = 0.3


class TestOurForceSensor(ForceSensorContract):
    """Runs the tests without noise, under a prescribed wrench."""

    @pytest.fixture
    def rig(self, own_rig: RigFile) -> ForceSensorRig:
        assert isinstance(own_rig.force_sensor, ForceSensorKeys), "[force_sensor] is not of a file of its own"
        keys, clock, (host, device) = own_rig.force_sensor, TwinClock(), serial_line()
        port = NoisyPort(host)
        sensor, twin = keys.driver(port, clock), twin_of(keys)(device, keys, (0.0,) * 6, np.random.default_rng(1))
        # A driver that is no `RecordStream` has no fixed record length; 64 bytes stand for it.
        record_bytes = sensor.record_bytes if isinstance(sensor, RecordStream) else 64
        rig = ForceSensorRig(
            clock=clock,
            sensor=sensor,
            twin=twin,
            rate_Hz=keys.rate_Hz,
            latency_s=LATENCY_S,
            resolution=0.5001 / np.repeat([keys.counts_per_N, keys.counts_per_Nm], 3)
            + SINGLE_PRECISION_RESOLUTION * np.array(twin.full_scale),
            saturating=(0.0, 0.0, 1.5 * twin.full_scale[2], 0.0, 0.0, 0.0),
            silence=lambda: setattr(port, "silent", True),
            lose=lambda: setattr(port, "drop", max(20, round(LOST_S * keys.rate_Hz)) * record_bytes),
            # Five records and three bytes: the damage ends inside a record, so the driver must resynchronise.
            damage=lambda: setattr(port, "spoil", 5 * record_bytes + 3),
            freeze=lambda: setattr(rig, "wrench", constant(1.0, 2.0, 3.0, 0.1, 0.2, 0.3)),
            time_step_s=2e-6,
        )
        return rig


class TestOurMotor(MotorContract):
    """Runs the tests. A twin may widen tolerances in `tolerances`, if its protocol is coarser than most."""

    @pytest.fixture(autouse=True)
    def _of_the_rig_file(self, own_rig: RigFile) -> None:
        assert isinstance(own_rig.motor, MotorKeys), "[motor] is not of a file of its own"
        self.keys = own_rig.motor
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


def find_conformance_tests(rig: RigFile) -> list[str]:
    """Test classes for the plug-in devices of a rig. Raises BadInput for a rig without any, and for a device without a twin."""
    pairs = (
        (rig.motor, MotorKeys, TestOurMotor),
        (rig.force_sensor, ForceSensorKeys, TestOurForceSensor),
    )
    own = [(keys, tests) for keys, kind, tests in pairs if isinstance(keys, kind)]
    if not own:
        raise BadInput(f'{rig.rig.title}: names no device = "own"; for the others the package keeps the contracts with tests of its own')
    for keys, _ in own:
        twin_of(keys)
    return [f"{__file__}::{tests.__name__}" for _, tests in own]


def run_conformance_tests(rig: RigFile, path: Path) -> bool:
    """Runs the tests; returns whether all passed. pytest prints the results."""
    # Neither a configuration nor a cache of the folder where the command is called must have an influence.
    options = ["-q", "--tb=short", "--no-header", "-p", "no:cacheprovider", "-c", os.devnull, "-o", "python_files=*.py"]
    return int(pytest.main([*options, "--rig", str(path), *find_conformance_tests(rig)], plugins=[sys.modules[__name__]])) == 0


def pytest_addoption(parser: pytest.Parser) -> None:
    """Adds the option; called by pytest."""
    parser.addoption("--rig", type=Path, metavar="FILE", help="a rig file with devices of your own")


@pytest.fixture(scope="session")
def own_rig(request: pytest.FixtureRequest) -> RigFile:
    """The rig file named by the option --rig."""
    return read_rig(request.config.getoption("--rig"))
