"""Runs the conformance tests on the plug-in devices of a rig file. The module itself is the plug-in of pytest with the option --rig."""

import os
import sys
from pathlib import Path

import pytest

from rfca_rig.contracts import own_devices
from rfca_rig.description.force_sensor_sections import ForceSensorKeys
from rfca_rig.description.motor_sections import MotorKeys
from rfca_rig.description.own_devices import twin_of
from rfca_rig.description.rig_file import RigFile, read_rig
from rfca_rig.errors import BadInput


def find_conformance_tests(rig: RigFile) -> list[str]:
    """Test classes for the plug-in devices of a rig. Raises BadInput for a rig without any, and for a device without a twin."""
    pairs = (
        (rig.motor, MotorKeys, own_devices.TestOurMotor),
        (rig.force_sensor, ForceSensorKeys, own_devices.TestOurForceSensor),
    )
    own = [(keys, tests) for keys, kind, tests in pairs if isinstance(keys, kind)]
    if not own:
        raise BadInput(f'{rig.rig.title}: names no device = "own"; for the others the package keeps the contracts with tests of its own')
    for keys, _ in own:
        twin_of(keys)
    return [f"{own_devices.__file__}::{tests.__name__}" for _, tests in own]


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
