"""A hash that identifies a recording, whatever its form on disk."""

import hashlib
from dataclasses import dataclass
from pathlib import Path

from rfca_rig.campaign.experiment_layout import FILE_NAME as EXPERIMENT
from rfca_rig.campaign.layout import FILE_NAME
from rfca_rig.campaign.pendulum_layout import FILE_NAME as PENDULUM
from rfca_rig.recording.identity import list_described_files, sha256_of, sum_line
from rfca_rig.recording.layout import ENDING, HEADER, RECORDING, stage_files


@dataclass(frozen=True)
class Fingerprint:
    """SHA-256 of `of`: of one file, or, for several files, of the lines of sha256sum for them, ordered by name."""

    of: str
    sha256: str


def fingerprint(path: Path) -> Fingerprint:
    """Fingerprint of what `open_recordings` opens at `path`. Raises OSError."""
    if path.is_file():
        return Fingerprint(path.name, sha256_of(path))
    if (path / RECORDING).is_file():
        return Fingerprint(RECORDING, sha256_of(path / RECORDING))
    files = _files(path)
    # Text in the format of sha256sum: the fingerprint can be verified without this program.
    lines = "".join(f"{sum_line(file, path)}\n" for file in files)
    return Fingerprint(f"the lines of sha256sum for {len(files)} files", hashlib.sha256(lines.encode()).hexdigest())


def _files(folder: Path) -> list[Path]:
    """For a campaign its description and tables; for an unmerged run its header, its stages and its end."""
    if any((folder / name).is_file() for name in (FILE_NAME, PENDULUM, EXPERIMENT)):
        return list_described_files(folder)
    named = [file for file in (folder / HEADER, folder / ENDING) if file.is_file()]
    return sorted([*named, *stage_files(folder), *folder.glob(f"{RECORDING}.partial/*.h5")])
