"""The worked examples' rig file, for the contracts."""

import pytest

from rfca_rig.description.rig_file import RigFile, read_rig
from tests.own_devices.rigs import EXAMPLES


@pytest.fixture(scope="session")
def own_rig() -> RigFile:
    """What the option --rig gives where the contracts run by themselves."""
    return read_rig(EXAMPLES / "our-rig.toml")
