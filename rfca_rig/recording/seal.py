"""A checksum behind the end of an HDF5 file, where HDF5 readers ignore it.

HDF5 takes flipped bits for data, and may search a damaged index for ever. A file states in its attribute `SEALED` that it has a checksum.
HDF5 cuts the checksum off when it opens a file for writing, and bytes behind it hide it: such a file was changed after it was written.
Files without the attribute, from versions before it, may lack a checksum.
"""

import hashlib
from collections.abc import Iterator
from pathlib import Path
from typing import BinaryIO

_MARK = b"rfca-seal"
_LENGTH = len(_MARK) + hashlib.sha256().digest_size
PIECE = 1 << 20


def seal_of(content_sha256: bytes) -> bytes:
    """The seal for content with that digest."""
    return _MARK + content_sha256


SEALED = "sealed"


def read_seal(path: Path) -> bool | None:
    """Whether the content is what was sealed; None where the file does not end in a seal. Raises OSError."""
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
        length = length - len(piece) if piece else 0
