"""SHA-256 of every file of a finished run, and a recording's identity, the same wherever its files lie and whatever they are called."""

import hashlib
import json
import re
from collections.abc import Mapping
from pathlib import Path

from rfca_rig.errors import BadInput
from rfca_rig.recording.atomic import write_atomically
from rfca_rig.recording.layout import BALLAST, DIAGNOSIS, EXPERIMENT, SUMS, WRITING, is_inside, read_bounded

_HASH = re.compile("[0-9a-f]{64}")

DIGITS = 32
# zstd: files of a ROS 2 bag that were compressed as a whole.
KINDS_OF_AN_EXPERIMENT = ("h5", "hdf5", "mcap", "db3", "zstd")


def write_sums(folder: Path, coming: Mapping[str, bytes] | None = None) -> None:
    """`SHA256SUMS`. `coming` has the content of files, by name, that will be written after it."""
    coming = coming or {}
    # Sorted, so that the same run gives the same bytes.
    # The reserve is gone after the run, files being written are not part of it, and links may show files of somebody else.
    files = sorted(
        file
        for file in folder.rglob("*")
        if file.is_file() and file.name not in (SUMS, BALLAST) and file.suffix != WRITING and not file.is_symlink()
    )
    names = {file: file.relative_to(folder).as_posix() for file in files}
    lines = (
        f"{hashlib.sha256(coming[name]).hexdigest()}  {name}" if name in coming else sum_line(file, folder) for file, name in names.items()
    )
    write_atomically(folder / SUMS, "".join(f"{line}\n" for line in lines).encode())


def sum_line(file: Path, folder: Path) -> str:
    """A file's line in the format of sha256sum, without the line end."""
    return f"{sha256_of(file)}  {file.relative_to(folder).as_posix()}"


def read_sums(folder: Path) -> dict[str, str]:
    """Hash by path in the folder; empty for a run that has not been finished. Raises BadInput for malformed lines."""
    path = folder / SUMS
    if not path.is_file():
        return {}
    sums: dict[str, str] = {}
    text = read_bounded(path).decode(errors="replace")
    # By line feeds alone: names may hold other characters that end a line elsewhere.
    *lines, behind = text.split("\n")
    for number, line in enumerate(lines, start=1):
        hashed, _, name = line.partition("  ")
        if not _HASH.fullmatch(hashed) or not is_inside(name) or not name or name in sums:
            raise BadInput(f"{path}:{number}: is no line of sha256sum for a file of this folder")
        sums[name] = hashed
    if behind:
        raise BadInput(f"{path}:{len(lines) + 1}: is cut short")
    return sums


def sha256_of(file: Path) -> str:
    with file.open("rb") as content:
        return hashlib.file_digest(content, "sha256").hexdigest()


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
    # A diagnosis that was written below the folder has tables of its own.
    files = (*descriptions, *(file for file in tables if not (file.parent / DIAGNOSIS).is_file()))
    # A pipe of such a name would be waited for.
    return sorted(file for file in files if file.is_file())


def identity_of_tables(title: str, folder: Path) -> str:
    """Identity of recordings from elsewhere that are read in place, a description and tables below `folder`. Raises OSError."""
    sums = "".join(f"{sum_line(file, folder)}\n" for file in list_described_files(folder))
    return identity_of(title, "IMPORT", {"sha256": hashlib.sha256(sums.encode()).hexdigest()})
