"""pytest's option --rig: the rig file whose own devices are to keep the contract."""

from pathlib import Path

import pytest

from rfca_rig.description.rig_file import RigFile, read_rig


def pytest_addoption(parser: pytest.Parser) -> None:
    """Called by pytest."""
    parser.addoption("--rig", type=Path, metavar="FILE", help="a rig file with devices of your own")


@pytest.fixture(scope="session")
def described(request: pytest.FixtureRequest) -> RigFile:
    """The rig file that was named."""
    return read_rig(request.config.getoption("--rig"))
