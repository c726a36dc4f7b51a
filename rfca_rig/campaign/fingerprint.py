"""A hash by which a recording is known again, whichever form it has on disk."""

import hashlib
from dataclasses import dataclass
from pathlib import Path

from rfca_rig.campaign.experiment_layout import FILE_NAME as EXPERIMENT
from rfca_rig.campaign.layout import FILE_NAME
from rfca_rig.campaign.pendulum_layout import FILE_NAME as PENDULUM
from rfca_rig.recording.identity import described_files
from rfca_rig.recording.layout import ENDING, HEADER, RECORDING, stage_files
from rfca_rig.recording.sums import sha256_of, sum_line


@dataclass(frozen=True)
class Fingerprint:
    """SHA-256 of `of`: of one file, or, of several, of the lines that sha256sum writes for them in their order by name."""

    of: str
    sha256: str


def fingerprint(path: Path) -> Fingerprint:
    """Of what `open_recordings` opens there. Raises OSError."""
    if path.is_file():
        return Fingerprint(path.name, sha256_of(path))
    if (path / RECORDING).is_file():
        return Fingerprint(RECORDING, sha256_of(path / RECORDING))
    files = _files(path)
    lines = "".join(f"{sum_line(file, path)}\n" for file in files)
    return Fingerprint(f"the lines of sha256sum for {len(files)} files", hashlib.sha256(lines.encode()).hexdigest())


def _files(folder: Path) -> list[Path]:
    """Of a campaign its description and its tables; of a run that is not put together its header, its stages and how it ended."""
    if any((folder / name).is_file() for name in (FILE_NAME, PENDULUM, EXPERIMENT)):
        return described_files(folder)
    named = [file for file in (folder / HEADER, folder / ENDING) if file.is_file()]
    return sorted([*named, *stage_files(folder), *folder.glob(f"{RECORDING}.partial/*.h5")])
