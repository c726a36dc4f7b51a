"""A checksum behind the end of an HDF5 file, where every reader of HDF5 passes over it.

HDF5 reads a file with flipped bits as if they were meant, and can search a damaged index for ever. Whoever opens the file for
writing cuts the seal off; such a file counts as edited, not as damaged.
"""

import hashlib

_MARK = b"rfca-seal"
_LENGTH = len(_MARK) + hashlib.sha256().digest_size


def sealed(content: bytes) -> bytes:
    """The content with its seal behind it."""
    return content + _MARK + hashlib.sha256(content).digest()


def is_broken(content: bytes) -> bool:
    """Whether there is a seal and the content is not what was sealed."""
    body, seal = content[:-_LENGTH], content[-_LENGTH:]
    return seal.startswith(_MARK) and sealed(body) != content
