"""What tells one recording from all others, wherever its files lie and whatever they are called."""

import hashlib
import json
from collections.abc import Mapping
from pathlib import Path

from rfca_rig.recording.sums import sum_line

DIGITS = 32


def identity_of(title: str, source: str, provenance: Mapping[str, str]) -> str:
    """32 hexadecimal digits. The provenance holds the SHA-256 of what was recorded, so that different recordings differ.

    A run that goes on, or is recovered, is another recording than it was.
    """
    text = json.dumps([title, source, dict(provenance)], sort_keys=True, ensure_ascii=True)
    return hashlib.sha256(text.encode()).hexdigest()[:DIGITS]


def identity_of_tables(title: str, folder: Path) -> str:
    """The same of recordings from elsewhere that are read as they stand, a description and tables below `folder`. Raises OSError."""
    files = sorted([*folder.glob("*.toml"), *folder.rglob("*.csv")])
    sums = "".join(f"{sum_line(file, folder)}\n" for file in files)
    return identity_of(title, "IMPORT", {"sha256": hashlib.sha256(sums.encode()).hexdigest()})
