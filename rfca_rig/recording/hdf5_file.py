"""HDF5 files: written atomically and sealed by a checksum; read without following anything that
leads out of them.

A new file is written beside its place, sealed, forced to disk, renamed. Writing is a generator of
small steps, between which the caller can do something else.

HDF5 takes flipped bits for data, and may search a damaged index for ever. A file states in its
attribute `SEALED` that it has a checksum behind its end, where HDF5 readers ignore it. HDF5 cuts
the checksum off when it opens a file for writing, and bytes behind it hide it: such a file was
changed after it was written. Files without the attribute, from versions before it, may lack a
checksum.

HDF5 lets a dataset keep its bytes in any file of the user (external storage), or show parts of
other files (virtual datasets, external links). A reader that follows them hands out what it was
never given. A few bytes can also claim any number of rows, unpack to any number of bytes, and hard
links can show one dataset under any number of names. Entry point: `open_plain`.

References
----------
HDF5 File Format Specification 3.0, III.E (link messages), IV.A.2.h (external file list), IV.A.2.i
(layout messages).
"""

import hashlib
from collections.abc import Generator, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import BinaryIO, TypeVar

import h5py

from rfca_rig.recording.atomic import ErrorDeferringFile

_MARK = b"rfca-seal"
_LENGTH = len(_MARK) + hashlib.sha256().digest_size
PIECE = 1 << 20

T = TypeVar("T")
Steps = Generator[None, None, T]

# Deflate packs 1032 bytes into one at most (RFC 1951: 258 bytes for two bits); what claims more
# holds no data.
MOST_EXPANSION = 1100
# Fill values need no storage: a small dataset that was never written is allowed.
FREE_BYTES = 1 << 20
# A whole file may unpack to so many bytes, and so many more for each that it stores. Origin:
# campaigns and noisy sensors unpack to 1.1 to 3.5 times their size, ten minutes of a sensor whose
# counts never change to 10 times. A factor of 20 would refuse none of them either.
MOST_UNPACKED_BYTES = 256 << 20
UNPACKED_PER_STORED = 200
# A chunk is unpacked as a whole to read one value in it. Those that other programs choose have 1 MB
# (h5py) or 4 MB (NetCDF).
MOST_CHUNK_BYTES = 64 << 20
# Deflate makes incompressible data longer by less than 0.1 %; a chunk far longer than its values
# unpacks to more than them.
MOST_OVERHEAD = 1.1
# A path of 64 names is no layout of recordings.
MOST_DEPTH = 64
# Filters whose output has a size that was checked before. Others take it from the file, or are
# plugins.
FILTERS = {
    h5py.h5z.FILTER_DEFLATE,
    h5py.h5z.FILTER_SHUFFLE,
    h5py.h5z.FILTER_FLETCHER32,
    h5py.h5z.FILTER_LZF,
}


def seal_of(content_sha256: bytes) -> bytes:
    """The seal for content with that digest."""
    return _MARK + content_sha256


SEALED = "sealed"


def read_seal(path: Path) -> bool | None:
    """Whether the content is what was sealed; None where the file does not end in a seal. Raises
    OSError.
    """
    with path.open("rb") as file:
        length = file.seek(0, 2) - _LENGTH
        if length < 0:
            return None
        file.seek(length)
        seal = file.read()
        # No seal: an edited file, or one of another program, neither of which is damage.
        if not seal.startswith(_MARK):
            return None
        file.seek(0)
        digest = hashlib.sha256()
        for piece in _pieces(file, length):
            digest.update(piece)
        return seal_of(digest.digest()) == seal


def _pieces(file: BinaryIO, length: int) -> Iterator[bytes]:
    while length > 0:
        piece = file.read(min(PIECE, length))
        yield piece
        # A file that shrinks meanwhile gives empty pieces; without this the loop would not end.
        if not piece:
            return
        length -= len(piece)


def run_to_completion(steps: Steps[T]) -> T:
    """Runs all steps and returns the generator's result."""
    while True:
        try:
            next(steps)
        except StopIteration as done:
            result: T = done.value
            return result


class NewHdf5File:
    """`root` takes groups and datasets; `check`, called now and then, raises what the disk
    refused.
    """

    def __init__(self, path: Path) -> None:
        self._rough = ErrorDeferringFile(path)
        # No chunk cache: whole chunks are written, and never read again.
        self.root = h5py.File(self._rough, "w", rdcc_nbytes=0)
        self.root.attrs[SEALED] = True

    def check(self) -> None:
        """Raises RigError, DiskFull."""
        self._rough.check()

    def put_in_place(self) -> Steps[str]:
        """Closes, seals, and moves the file to its path; the result is its SHA-256. Raises
        RigError, DiskFull.
        """
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
    """Yields a new file, which is removed after the block unless it was put in place. Raises
    RigError where it cannot be begun.
    """
    made = NewHdf5File(path)
    try:
        yield made
    finally:
        made.discard()


class NotPlain(ValueError):
    """A part of an HDF5 file that is refused."""


@contextmanager
def open_plain(path: Path) -> Iterator[h5py.File]:
    """The file for reading, once every link and dataset in it was looked at.

    Raises
    ------
    NotPlain
        Where a link or dataset leads out of the file, is reached twice, or claims more bytes than
        its storage can hold.
    OSError, RuntimeError
        Where HDF5 cannot read the file.
    """
    with h5py.File(path, "r") as file:
        _Survey().check_group(file.id, "", 0)
        yield file


class _Survey:
    """What was seen of a file so far: the addresses of its objects, and the bytes that all
    datasets claim and store.
    """

    def __init__(self) -> None:
        self._seen: set[int] = set()
        self._claimed = self._stored = 0

    def check_group(self, group: h5py.h5g.GroupID, path: str, depth: int) -> None:
        """Look at a group and at everything below it: each object has one hard link."""
        self._seen.add(h5py.h5o.get_info(group).addr)
        if depth > MOST_DEPTH:
            raise NotPlain(f"a group lies {depth} groups deep, where {MOST_DEPTH} are the most")
        names: list[bytes] = []
        group.links.iterate(names.append)
        for name in names:
            where = f"{path}/{name.decode(errors='replace')}"
            if group.links.get_info(name).type != h5py.h5l.TYPE_HARD:
                raise NotPlain(
                    f"{where} is a link to elsewhere, which is not followed; copy what it "
                    "shows into the file"
                )
            item = h5py.h5o.open(group, name)
            address = h5py.h5o.get_info(item).addr
            if address in self._seen:
                raise NotPlain(
                    f"{where} shows an object that the file holds under another name; "
                    "each needs one name"
                )
            self._seen.add(address)
            if isinstance(item, h5py.h5g.GroupID):
                self.check_group(item, where, depth + 1)
            elif isinstance(item, h5py.h5d.DatasetID):
                self._check_dataset(item, where)

    def _check_dataset(self, dataset: h5py.h5d.DatasetID, where: str) -> None:
        made = dataset.get_create_plist()
        if made.get_layout() == h5py.h5d.VIRTUAL:
            raise NotPlain(
                f"{where} is a virtual dataset, which shows other files; copy its values "
                "into the file"
            )
        if made.get_external_count():
            raise NotPlain(
                f"{where} keeps its bytes in another file, "
                f"{made.get_external(0)[0].decode(errors='replace')}; copy them into the "
                "file"
            )
        claimed = dataset.get_space().get_simple_extent_npoints() * dataset.get_type().get_size()
        stored = dataset.get_storage_size()
        if claimed > FREE_BYTES + MOST_EXPANSION * stored:
            raise NotPlain(
                f"{where} claims {claimed / 1e6:.0f} MB, where {stored} bytes are stored"
            )
        if made.get_layout() == h5py.h5d.CHUNKED:
            _check_chunks(dataset, made, where)
        self._claimed += claimed
        self._stored += stored
        if self._claimed > MOST_UNPACKED_BYTES + UNPACKED_PER_STORED * self._stored:
            raise NotPlain(
                f"{where} and those before it unpack to {self._claimed / 1e6:.0f} MB from "
                f"{self._stored / 1e6:.1f} MB"
            )


def _check_chunks(dataset: h5py.h5d.DatasetID, made: h5py.h5p.PropDCID, where: str) -> None:
    """Refuse what could unpack to more than a chunk of the claimed size."""
    filters = [made.get_filter(number)[0] for number in range(made.get_nfilters())]
    if not FILTERS.issuperset(filters) or len(set(filters)) < len(filters):
        raise NotPlain(
            f"{where} is packed by filters {filters}, which are not read; write it again "
            "with gzip: h5repack -f GZIP=1"
        )
    size = dataset.get_type().get_size()
    for rows in made.get_chunk():
        size *= rows
    if size > MOST_CHUNK_BYTES:
        most = f"{MOST_CHUNK_BYTES / 1e6:.0f} MB are the most"
        raise NotPlain(
            f"{where} has chunks of {size / 1e6:.0f} MB, where {most}; write it again with h5repack"
        )

    def check(chunk: h5py.h5d.StoreInfo) -> None:
        if chunk.size > FREE_BYTES / 8 + MOST_OVERHEAD * size:
            raise NotPlain(
                f"{where} has a chunk of {size} bytes that is stored in {chunk.size}, so "
                "it unpacks to more than it claims"
            )

    dataset.chunk_iter(check)
