"""Opens an HDF5 file that may come from a stranger: nothing in it leads to another file, and no size is only a claim.

HDF5 lets a dataset keep its bytes in any file of the user (external storage), or show parts of other files (virtual datasets, external
links). A reader that follows them hands out what it was never given. A few bytes can also claim any number of rows, and hard links can
show one dataset under any number of names. Entry point: `open_plain`.

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
        _check_group(file.id, "", {h5py.h5o.get_info(file.id).addr})
        yield file


def _check_group(group: h5py.h5g.GroupID, path: str, seen: set[int]) -> None:
    """Look at everything below a group. `seen` are the addresses of the objects so far: each has one hard link."""
    names: list[bytes] = []
    group.links.iterate(names.append)
    for name in names:
        where = f"{path}/{name.decode(errors='replace')}"
        if group.links.get_info(name).type != h5py.h5l.TYPE_HARD:
            raise NotPlain(f"{where} is a link to elsewhere, which is not followed; copy what it shows into the file")
        item = h5py.h5o.open(group, name)
        address = h5py.h5o.get_info(item).addr
        if address in seen:
            raise NotPlain(f"{where} shows an object that the file holds under another name; each needs one name")
        seen.add(address)
        if isinstance(item, h5py.h5g.GroupID):
            _check_group(item, where, seen)
        elif isinstance(item, h5py.h5d.DatasetID):
            _check_dataset(item, where)


def _check_dataset(dataset: h5py.h5d.DatasetID, where: str) -> None:
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
