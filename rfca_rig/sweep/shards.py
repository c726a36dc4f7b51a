"""Computed cases on disk: an HDF5 file for each range of cases, either complete or absent.

The division into ranges depends on the speed of the cases; the content of their rows does not.
"""

import io
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path

import h5py
import numpy as np

from rfca_rig.errors import BadInput
from rfca_rig.recording.atomic import AppendOnlyFile, remove, translate_os_errors, write_atomically
from rfca_rig.recording.plain_hdf5 import open_plain
from rfca_rig.recording.run_lock import lock
from rfca_rig.sweep.cases import LONGEST_REMARK, CaseRange, CaseRows

FOLDER, LOCK = "shards", "lock"
# UTF-8 needs up to four bytes per character.
TEXT = f"S{4 * LONGEST_REMARK}"


class Shards:
    """The shards of one plan, known by its digest, in `folder`/shards."""

    def __init__(self, folder: Path, digest: str) -> None:
        self.folder, self._digest = folder / FOLDER, digest

    @contextmanager
    def held(self) -> Iterator[None]:
        """Within the context no other process writes here. Raises BadInput where one already does."""
        with translate_os_errors(self.folder, "the folder cannot be made"):
            self.folder.mkdir(exist_ok=True)
        file = AppendOnlyFile(self.folder / LOCK)
        lock(file)
        try:
            yield
        finally:
            file.close()

    def write(self, span: CaseRange, rows: CaseRows) -> None:
        """Write the rows of a range; on return they are on disk. Raises RigError, DiskFull."""
        # Built in memory and written in one piece, so that a crash never leaves half a file.
        content = io.BytesIO()
        with h5py.File(content, "w") as file:
            file.attrs["plan"] = self._digest
            file.create_dataset("values", data=rows.values)
            file.create_dataset("remarks", data=np.array([remark.encode() for remark in rows.remarks], dtype=TEXT), compression=1)
        write_atomically(self._path(span), content.getvalue())

    def spans(self) -> list[CaseRange]:
        """Ranges of all existing shards, in order."""
        names = (path.stem.split("-") for path in self.folder.glob("cases-*.h5"))
        return sorted((CaseRange(int(first), int(last)) for _, first, last in names), key=lambda span: span.first)

    def read(self, span: CaseRange) -> CaseRows:
        """Read the rows of a range. Raises BadInput where the file is damaged, or of another plan."""
        path = self._path(span)
        try:
            with open_plain(path) as file:
                digest, values = file.attrs["plan"], np.asarray(file["values"][()], dtype=np.float64)
                remarks = tuple(remark.decode() for remark in file["remarks"][()])
        except (OSError, KeyError, ValueError) as error:
            raise BadInput(f"{path}: cannot be read ({' '.join(str(error).split())}); remove it, and its cases are computed anew") from None
        if digest != self._digest or len(values) != len(span) != len(remarks):
            raise BadInput(f"{path}: is of another sweep; remove it, and its cases are computed anew")
        return CaseRows(values, remarks)

    def clear(self) -> None:
        """Remove all shards, once their rows are stored in the result."""
        for path in self.folder.iterdir():
            remove(path)
        with translate_os_errors(self.folder, "cannot be removed"):
            self.folder.rmdir()

    def _path(self, span: CaseRange) -> Path:
        return self.folder / f"cases-{span.first:08d}-{span.last:08d}.h5"


def find_gaps(count: int, there: Iterable[CaseRange]) -> list[CaseRange]:
    """Ranges of the `count` cases that `there`, in order, does not cover."""
    gaps, at = [], 0
    for span in there:
        if span.first > at:
            gaps.append(CaseRange(at, span.first))
        at = max(at, span.last)
    return [*gaps, CaseRange(at, count)] if at < count else gaps


def split_gaps(gaps: Iterable[CaseRange], size: int) -> list[CaseRange]:
    """Divide the gaps into ranges of at most `size` cases."""
    return [CaseRange(first, min(first + size, gap.last)) for gap in gaps for first in range(gap.first, gap.last, size)]
