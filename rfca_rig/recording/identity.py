"""A recording's identity: the same wherever its files lie and whatever they are called."""

import hashlib
import json
from collections.abc import Mapping
from pathlib import Path

from rfca_rig.recording.layout import DIAGNOSIS, EXPERIMENT
from rfca_rig.recording.sums import sum_line

DIGITS = 32
# zstd: files of a ROS 2 bag that were compressed as a whole.
KINDS_OF_AN_EXPERIMENT = ("h5", "hdf5", "mcap", "db3", "zstd")


def identity_of(title: str, source: str, provenance: Mapping[str, str]) -> str:
    """32 hexadecimal digits from title, source and provenance. The provenance has the SHA-256 of the recorded files.

    A run that was continued or recovered has another identity than before.
    """
    # Sorted keys: the identity must not depend on the order of a dictionary.
    text = json.dumps([title, source, dict(provenance)], sort_keys=True, ensure_ascii=True)
    return hashlib.sha256(text.encode()).hexdigest()[:DIGITS]


def list_described_files(folder: Path) -> list[Path]:
    """Of recordings from elsewhere: description, model file and recordings, sorted by name."""
    kinds = ("csv", *KINDS_OF_AN_EXPERIMENT) if (folder / EXPERIMENT).is_file() else ("csv",)
    descriptions = (file for ending in ("toml", "xml", "urdf") for file in folder.glob(f"*.{ending}"))
    tables = (file for ending in kinds for file in folder.rglob(f"*.{ending}"))
    # a diagnosis that was written below the folder has tables of its own
    return sorted([*descriptions, *(file for file in tables if not (file.parent / DIAGNOSIS).is_file())])


def identity_of_tables(title: str, folder: Path) -> str:
    """Identity of recordings from elsewhere that are read in place, a description and tables below `folder`. Raises OSError."""
    sums = "".join(f"{sum_line(file, folder)}\n" for file in list_described_files(folder))
    return identity_of(title, "IMPORT", {"sha256": hashlib.sha256(sums.encode()).hexdigest()})
