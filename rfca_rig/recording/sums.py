"""SHA-256 of every file of a finished run, in the format of sha256sum."""

import hashlib
from pathlib import Path

from rfca_rig.errors import BadInput
from rfca_rig.recording.atomic import write_atomically
from rfca_rig.recording.layout import BALLAST, SUMS, WRITING


def write_sums(folder: Path) -> None:
    """`SHA256SUMS`, the last file of a run."""
    # Sorted, so that the same run gives the same bytes.
    files = sorted(file for file in folder.rglob("*") if file.is_file() and _belongs(file))
    write_atomically(folder / SUMS, "".join(f"{sum_line(file, folder)}\n" for file in files).encode())


def sum_line(file: Path, folder: Path) -> str:
    """A file's line in the format of sha256sum, without the line end."""
    return f"{sha256_of(file)}  {file.relative_to(folder).as_posix()}"


def _belongs(file: Path) -> bool:
    # The reserve is gone after the run, and files being written are not part of it.
    return file.name not in (SUMS, BALLAST) and file.suffix != WRITING


def read_sums(folder: Path) -> dict[str, str]:
    """Hash by path in the folder; empty for a run that has not been finished. Raises BadInput for malformed lines."""
    path = folder / SUMS
    if not path.is_file():
        return {}
    sums = {}
    for number, line in enumerate(path.read_text(errors="replace").splitlines(), start=1):
        hashed, _, name = line.partition("  ")
        if len(hashed) != hashlib.sha256().digest_size * 2 or not name:
            raise BadInput(f"{path}:{number}: is no line of sha256sum")
        sums[name] = hashed
    return sums


def sha256_of(file: Path) -> str:
    with file.open("rb") as content:
        return hashlib.file_digest(content, "sha256").hexdigest()
