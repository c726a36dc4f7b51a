"""A stage in progress as it goes to disk: blocks one after the other, each with its length and a checksum.

A block is handed from the control loop to the recorder in the very bytes that the journal keeps. What stands behind the last whole
block, after a crash or a power cut, is passed over.
"""

import struct
import zlib
from collections.abc import Iterator
from dataclasses import dataclass
from enum import IntEnum
from pathlib import Path

_HEAD = struct.Struct("<2sBxII")
_MARK = b"RB"
LARGEST = 16 << 20  # of a block: a length above it is damage
PIECE = 1 << 20


class BlockKind(IntEnum):
    """What a block says. All but SAMPLES are JSON."""

    BEGIN = 1
    START = 2
    SAMPLES = 3
    END = 4
    EVENT = 5


_KINDS = {int(kind) for kind in BlockKind}


@dataclass(frozen=True)
class JournalBlock:
    """One message of the control loop."""

    kind: BlockKind
    payload: bytes


def framed(block: JournalBlock) -> bytes:
    """The block with its head: mark, kind, length and CRC-32, 12 bytes little endian. Raises ValueError for one above `LARGEST`."""
    if len(block.payload) > LARGEST:
        raise ValueError(f"a block of {len(block.payload)} bytes")
    return _HEAD.pack(_MARK, block.kind, len(block.payload), _checksum(block.kind, block.payload)) + block.payload


def whole_blocks(content: bytes) -> tuple[list[JournalBlock], int]:
    """The blocks from the beginning up to the first that is torn or damaged, and how many bytes they take."""
    blocks, used = [], 0
    for block in _blocks(memoryview(content)):
        blocks.append(block)
        used += size_of(block)
    return blocks, used


def size_of(block: JournalBlock) -> int:
    """Bytes with its head."""
    return _HEAD.size + len(block.payload)


def blocks_in(path: Path) -> Iterator[JournalBlock]:
    """Those of `whole_blocks` from a file of any length, of which little is in memory at a time. Raises OSError."""
    with path.open("rb") as file:
        rest = b""
        while piece := file.read(PIECE):
            blocks, used = whole_blocks(rest + piece)
            rest = (rest + piece)[used:]
            yield from blocks
            if not _may_go_on(rest):
                return


def _may_go_on(rest: bytes) -> bool:
    """Whether more bytes may make a block of what stands behind the last one."""
    if len(rest) < _HEAD.size:
        return True
    mark, kind, length, _ = _HEAD.unpack_from(rest)
    return mark == _MARK and kind in _KINDS and length <= LARGEST and len(rest) < _HEAD.size + length


def _blocks(content: memoryview) -> Iterator[JournalBlock]:
    at = 0
    while len(content) - at >= _HEAD.size:
        mark, kind, length, checksum = _HEAD.unpack_from(content, at)
        payload = bytes(content[at + _HEAD.size : at + _HEAD.size + length])
        if mark != _MARK or len(payload) != length or checksum != _checksum(kind, payload) or kind not in _KINDS:
            return
        yield JournalBlock(BlockKind(kind), payload)
        at += _HEAD.size + length


def _checksum(kind: int, payload: bytes) -> int:
    return zlib.crc32(payload, kind)
