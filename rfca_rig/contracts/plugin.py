"""pytest option --rig: the rig file whose plug-in devices are tested."""

from pathlib import Path

import pytest

from rfca_rig.description.rig_file import RigFile, read_rig


def pytest_addoption(parser: pytest.Parser) -> None:
    """Adds the option; called by pytest."""
    parser.addoption("--rig", type=Path, metavar="FILE", help="a rig file with devices of your own")


@pytest.fixture(scope="session")
def own_rig(request: pytest.FixtureRequest) -> RigFile:
    """The rig file named by the option --rig."""
    return read_rig(request.config.getoption("--rig"))
