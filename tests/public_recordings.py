"""Recordings that other people published, for tests: a folder of this computer has them.

The variable RFCA_RIG_DATASETS names it; `rfca-rig datasets get` fills it. A test that needs
recordings which are not there is skipped, and says so.
"""

import os
import shutil
from pathlib import Path

import pytest

from rfca_rig.public_data.library import write_set
from rfca_rig.public_data.registry import read_registry
from rfca_rig.public_data.sources import RECORDINGS_VARIABLE

# Descriptions in the format of pendulums, by group of recordings.
PENDULUMS = Path(__file__).parent / "real" / "pendulums"


def explain_absence(group: str) -> str:
    """Why the recordings of a group are not there; "" if they are."""
    stated = os.environ.get(RECORDINGS_VARIABLE)
    if not stated:
        return f"{RECORDINGS_VARIABLE} is not set: no public recordings"
    if not (Path(stated) / group).is_dir():
        return f"{RECORDINGS_VARIABLE} has no {group}"
    return ""


def find_recordings(group: str) -> Path:
    """The folder of a group of recordings, as dfki-pendulum/simple; else the test is skipped."""
    absence = explain_absence(group)
    if absence:
        pytest.skip(absence)
    return Path(os.environ[RECORDINGS_VARIABLE]).resolve() / group


def write_public_set(name: str, folder: Path) -> None:
    """Write a set with its description and model into a folder; else the test is skipped."""
    public_set = read_registry().find(name)
    write_set(public_set, find_recordings(public_set.group.name), folder)


def write_public_pendulum(group: str, folder: Path) -> Path:
    """Write recordings with pendulum.toml into a folder; else the test is skipped."""
    recordings = find_recordings(group)
    folder.mkdir(parents=True, exist_ok=True)
    shutil.copy(PENDULUMS / f"{recordings.name}.toml", folder / "pendulum.toml")
    shutil.copytree(recordings / "runs", folder / "runs")
    return folder
