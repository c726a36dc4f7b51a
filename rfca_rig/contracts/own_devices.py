"""Conformance tests on the plug-in drive and force sensor of a rig file, and their twins;
`MotorOfAMake` also tests the built-in drives.

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
from rfca_rig.description.rig_file import RigFile, read_rig
from rfca_rig.devices import FORCE_SENSORS, MOTORS, find_motor, find_sensor
from rfca_rig.devices.own import twin_of
from rfca_rig.devices.sections import ForceSensorKeys, ForceSensorSection, MotorKeys, MotorSection
from rfca_rig.drivers.record_stream import RecordStream
from rfca_rig.drivers.roles import ShaftMotor
from rfca_rig.errors import BadInput
from rfca_rig.twins.drive_parts import LoopGains
from rfca_rig.twins.wires import can_wire, serial_line

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
        assert is_plug_in_sensor(own_rig.force_sensor), (
            "[force_sensor] is neither of a file of its own nor of an installed package"
        )
        keys: Any = own_rig.force_sensor
        make = find_sensor(keys.device)
        clock = TwinClock()
        (host, device) = serial_line()
        port = NoisyPort(host)
        sensor = make.make_driver(keys, port, clock)
        twin: Any = make.make_twin(device, keys, (0.0,) * 6, np.random.default_rng(1))
        # A driver that is no `RecordStream` has no fixed record length; 64 bytes stand for it.
        if isinstance(sensor, RecordStream):
            record_bytes = sensor.record_bytes
        else:
            record_bytes = 64
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
            lose=lambda: setattr(
                port, "drop", max(20, round(LOST_S * keys.rate_Hz)) * record_bytes
            ),
            # Five records and three bytes: the damage ends inside a record, so the driver must
            # resynchronise.
            damage=lambda: setattr(port, "spoil", 5 * record_bytes + 3),
            freeze=lambda: setattr(rig, "wrench", constant(1.0, 2.0, 3.0, 0.1, 0.2, 0.3)),
            time_step_s=2e-6,
        )
        return rig


class MotorOfAMake(MotorContract):
    """The tests on the motor of `keys`, with driver and twin as its make has them. The twin may
    widen tolerances (`tolerances`).
    """

    keys: MotorSection

    def use(self, keys: MotorSection) -> None:
        """Tests that motor, with the tolerances of its twin."""
        self.keys = keys
        with can_wire() as (_, end):
            twin = self.twin(end, None)
        self.TELLS_TEMPERATURE = getattr(twin, "tells_temperature", False)
        for name, value in getattr(twin, "tolerances", {}).items():
            setattr(self, name, value)

    def driver(self, bus: can.BusABC, clock: Clock) -> ShaftMotor:
        return find_motor(self.keys.device).make_driver(self.keys, bus, clock, SILENT_S)

    def twin(self, bus: can.BusABC, watchdog_s: float | None) -> Any:
        return find_motor(self.keys.device).make_twin(self.keys, bus, LoopGains(), watchdog_s)

    def leave_stale_set_point(self, bus: can.BusABC) -> None:
        for message in self.twin(bus, None).stale_set_point():
            bus.send(message)

    def fail(self, twin: Any) -> str:
        return str(twin.fail())

    def refuse(self, twin: Any) -> str:
        return str(twin.refuse())


class TestOurMotor(MotorOfAMake):
    """Runs the tests on the motor of the rig file."""

    @pytest.fixture(autouse=True)
    def _of_the_rig_file(self, own_rig: RigFile) -> None:
        assert is_plug_in(own_rig.motor), (
            "[motor] is neither of a file of its own nor of an installed package"
        )
        self.use(own_rig.motor)


def is_plug_in(keys: MotorSection) -> bool:
    """Whether the drive is not one that the package knows."""
    return isinstance(keys, MotorKeys) or keys.device not in MOTORS


def is_plug_in_sensor(keys: ForceSensorSection) -> bool:
    """The same of a force sensor."""
    return isinstance(keys, ForceSensorKeys) or keys.device not in FORCE_SENSORS


def find_conformance_tests(rig: RigFile) -> list[str]:
    """Test classes for the plug-in devices of a rig. Raises BadInput for a rig without any, and
    for a device without a twin.
    """
    test_classes: list[type] = []
    if is_plug_in(rig.motor):
        test_classes.append(TestOurMotor)
    if is_plug_in_sensor(rig.force_sensor):
        test_classes.append(TestOurForceSensor)
    if not test_classes:
        raise BadInput(
            f'{rig.rig.title}: names no device = "own"; for the others the package keeps '
            "the contracts with tests of its own"
        )
    for keys in (rig.motor, rig.force_sensor):
        if isinstance(keys, MotorKeys | ForceSensorKeys):
            twin_of(keys)
    return [f"{__file__}::{tests.__name__}" for tests in test_classes]


def run_conformance_tests(rig: RigFile, path: Path) -> bool:
    """Runs the tests; returns whether all passed. pytest prints the results."""
    # Neither a configuration nor a cache of the folder where the command is called must have an
    # influence.
    options = [
        "-q",
        "--tb=short",
        "--no-header",
        "-p",
        "no:cacheprovider",
        "-c",
        os.devnull,
        "-o",
        "python_files=*.py",
    ]
    return (
        int(
            pytest.main(
                [*options, "--rig", str(path), *find_conformance_tests(rig)],
                plugins=[sys.modules[__name__]],
            )
        )
        == 0
    )


def pytest_addoption(parser: pytest.Parser) -> None:
    """Adds the option; called by pytest."""
    parser.addoption("--rig", type=Path, metavar="FILE", help="a rig file with devices of your own")


@pytest.fixture(scope="session")
def own_rig(request: pytest.FixtureRequest) -> RigFile:
    """The rig file named by the option --rig."""
    return read_rig(request.config.getoption("--rig"))
