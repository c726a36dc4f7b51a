"""Opens an HDF5 file that may come from a stranger: nothing in it leads to another file, and no size is only a claim.

HDF5 lets a dataset keep its bytes in any file of the user (external storage), or show parts of other files (virtual datasets, external
links). A reader that follows them hands out what it was never given. A few bytes can also claim any number of rows, unpack to any number
of bytes, and hard links can show one dataset under any number of names. Entry point: `open_plain`.

References
----------
HDF5 File Format Specification 3.0, III.E (link messages), IV.A.2.h (external file list), IV.A.2.i (layout messages).
"""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import h5py

# Deflate packs 1032 bytes into one at most (RFC 1951: 258 bytes for two bits); what claims more holds no data.
MOST_EXPANSION = 1100
# Fill values need no storage: a small dataset that was never written is allowed.
FREE_BYTES = 1 << 20
# A whole file may unpack to so many bytes, and so many more for each that it stores. Origin: campaigns and noisy sensors unpack to 1.1 to
# 3.5 times their size, ten minutes of a sensor whose counts never change to 10 times. A factor of 20 would refuse none of them either.
MOST_UNPACKED_BYTES = 256 << 20
UNPACKED_PER_STORED = 200
# A chunk is unpacked as a whole to read one value in it. Those that other programs choose have 1 MB (h5py) or 4 MB (NetCDF).
MOST_CHUNK_BYTES = 64 << 20
# Deflate makes incompressible data longer by less than 0.1 %; a chunk far longer than its values unpacks to more than them.
MOST_OVERHEAD = 1.1
# A path of 64 names is no layout of recordings.
MOST_DEPTH = 64
# Filters whose output has a size that was checked before. Others take it from the file, or are plugins.
FILTERS = {h5py.h5z.FILTER_DEFLATE, h5py.h5z.FILTER_SHUFFLE, h5py.h5z.FILTER_FLETCHER32, h5py.h5z.FILTER_LZF}


class NotPlain(ValueError):
    """A part of an HDF5 file that is refused."""


@contextmanager
def open_plain(path: Path) -> Iterator[h5py.File]:
    """The file for reading, once every link and dataset in it was looked at.

    Raises
    ------
    NotPlain
        Where a link or dataset leads out of the file, is reached twice, or claims more bytes than its storage can hold.
    OSError, RuntimeError
        Where HDF5 cannot read the file.
    """
    with h5py.File(path, "r") as file:
        _Survey().check_group(file.id, "", 0)
        yield file


class _Survey:
    """What was seen of a file so far: the addresses of its objects, and the bytes that all datasets claim and store."""

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
                raise NotPlain(f"{where} is a link to elsewhere, which is not followed; copy what it shows into the file")
            item = h5py.h5o.open(group, name)
            address = h5py.h5o.get_info(item).addr
            if address in self._seen:
                raise NotPlain(f"{where} shows an object that the file holds under another name; each needs one name")
            self._seen.add(address)
            if isinstance(item, h5py.h5g.GroupID):
                self.check_group(item, where, depth + 1)
            elif isinstance(item, h5py.h5d.DatasetID):
                self._check_dataset(item, where)

    def _check_dataset(self, dataset: h5py.h5d.DatasetID, where: str) -> None:
        made = dataset.get_create_plist()
        if made.get_layout() == h5py.h5d.VIRTUAL:
            raise NotPlain(f"{where} is a virtual dataset, which shows other files; copy its values into the file")
        if made.get_external_count():
            raise NotPlain(
                f"{where} keeps its bytes in another file, {made.get_external(0)[0].decode(errors='replace')}; copy them into the file"
            )
        claimed = dataset.get_space().get_simple_extent_npoints() * dataset.get_type().get_size()
        stored = dataset.get_storage_size()
        if claimed > FREE_BYTES + MOST_EXPANSION * stored:
            raise NotPlain(f"{where} claims {claimed / 1e6:.0f} MB, where {stored} bytes are stored")
        if made.get_layout() == h5py.h5d.CHUNKED:
            _check_chunks(dataset, made, where)
        self._claimed += claimed
        self._stored += stored
        if self._claimed > MOST_UNPACKED_BYTES + UNPACKED_PER_STORED * self._stored:
            raise NotPlain(f"{where} and those before it unpack to {self._claimed / 1e6:.0f} MB from {self._stored / 1e6:.1f} MB")


def _check_chunks(dataset: h5py.h5d.DatasetID, made: h5py.h5p.PropDCID, where: str) -> None:
    """Refuse what could unpack to more than a chunk of the claimed size."""
    filters = [made.get_filter(number)[0] for number in range(made.get_nfilters())]
    if not FILTERS.issuperset(filters) or len(set(filters)) < len(filters):
        raise NotPlain(f"{where} is packed by filters {filters}, which are not read; write it again with gzip: h5repack -f GZIP=1")
    size = dataset.get_type().get_size()
    for rows in made.get_chunk():
        size *= rows
    if size > MOST_CHUNK_BYTES:
        most = f"{MOST_CHUNK_BYTES / 1e6:.0f} MB are the most"
        raise NotPlain(f"{where} has chunks of {size / 1e6:.0f} MB, where {most}; write it again with h5repack")

    def check(chunk: h5py.h5d.StoreInfo) -> None:
        if chunk.size > FREE_BYTES / 8 + MOST_OVERHEAD * size:
            raise NotPlain(f"{where} has a chunk of {size} bytes that is stored in {chunk.size}, so it unpacks to more than it claims")

    dataset.chunk_iter(check)
