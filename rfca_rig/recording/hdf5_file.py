"""HDF5 files on their way to the disk, of any size: written beside their place, sealed, forced to disk, renamed."""

import hashlib
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import h5py

from rfca_rig.recording.atomic import ErrorDeferringFile
from rfca_rig.recording.cooperative import Steps
from rfca_rig.recording.seal import PIECE, SEALED, seal_of


class NewHdf5File:
    """`root` takes groups and datasets; `check`, called now and then, raises what the disk refused."""

    def __init__(self, path: Path) -> None:
        self._rough = ErrorDeferringFile(path)
        # No chunk cache: whole chunks are written, and never read again.
        self.root = h5py.File(self._rough, "w", rdcc_nbytes=0)
        self.root.attrs[SEALED] = True

    def check(self) -> None:
        """Raises RigError, DiskFull."""
        self._rough.check()

    def put_in_place(self) -> Steps[str]:
        """Closes, seals, and moves the file to its path; the result is its SHA-256. Raises RigError, DiskFull."""
        # HDF5 must close first, whatever the disk refused; see `ErrorDeferringFile`.
        self.root.close()
        self.check()
        digest = hashlib.sha256()
        self._rough.seek(0)
        while piece := self._rough.read(PIECE):
            digest.update(piece)
            yield
        # Behind the end of the HDF5 content, where readers ignore it.
        seal = seal_of(digest.digest())
        self._rough.write(memoryview(seal))
        digest.update(seal)
        self._rough.put_in_place()
        return digest.hexdigest()

    def discard(self) -> None:
        """Removes the file unless it was put in place."""
        self.root.close()
        self._rough.discard()


@contextmanager
def new_hdf5_file(path: Path) -> Iterator[NewHdf5File]:
    """Yields a new file, which is removed after the block unless it was put in place. Raises RigError where it cannot be begun."""
    made = NewHdf5File(path)
    try:
        yield made
    finally:
        made.discard()
