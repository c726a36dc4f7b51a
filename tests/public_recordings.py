"""Recordings that other people published, for tests: a folder of this computer has them.

The variable RFCA_RIG_DATASETS names it; `rfca-rig datasets get` fills it. A test that needs
recordings which are not there is skipped, and says so.
"""

import os
from pathlib import Path

import pytest

from rfca_rig.public_data.sources import RECORDINGS_VARIABLE


def find_recordings(group: str) -> Path:
    """The folder of a group of recordings, as dfki-pendulum/simple."""
    stated = os.environ.get(RECORDINGS_VARIABLE)
    if not stated:
        pytest.skip(f"{RECORDINGS_VARIABLE} is not set: no public recordings")
    folder = Path(stated).resolve() / group
    if not folder.is_dir():
        pytest.skip(f"{RECORDINGS_VARIABLE} has no {group}")
    return folder
