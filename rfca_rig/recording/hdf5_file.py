"""HDF5 files on their way to the disk, of any size: written beside their place, sealed, forced to disk, renamed."""

import hashlib
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import h5py

from rfca_rig.recording.atomic import RoughFile
from rfca_rig.recording.cooperative import Steps
from rfca_rig.recording.seal import PIECE, SEALED, seal_of


class FileBeingMade:
    """`root` takes groups and datasets; `check` after some of them raises what the disk refused."""

    def __init__(self, path: Path) -> None:
        self._rough = RoughFile(path)
        self.root = h5py.File(self._rough, "w", rdcc_nbytes=0)  # whole chunks are written, and never looked at again
        self.root.attrs[SEALED] = True

    def check(self) -> None:
        """Raises RigError, DiskFull."""
        self._rough.check()

    def put_in_place(self) -> Steps[str]:
        """Closes, seals, and puts the file where it belongs; comes to its SHA-256. Raises RigError, DiskFull."""
        self.root.close()
        self.check()
        digest = hashlib.sha256()
        self._rough.seek(0)
        while piece := self._rough.read(PIECE):
            digest.update(piece)
            yield
        seal = seal_of(digest.digest())
        self._rough.write(memoryview(seal))
        digest.update(seal)
        self._rough.put_in_place()
        return digest.hexdigest()

    def discard(self) -> None:
        """Takes away what is not in its place."""
        self.root.close()
        self._rough.discard()


@contextmanager
def being_made(path: Path) -> Iterator[FileBeingMade]:
    """A file that is gone after the block unless it was put in place. Raises RigError where it cannot be begun."""
    made = FileBeingMade(path)
    try:
        yield made
    finally:
        made.discard()
