"""A stage in progress on disk: blocks one after the other, each with its length and a checksum.

The control loop hands a block to the recorder in the very bytes that the journal stores. After a
crash or a power cut, everything behind the last whole block is ignored.

Messages of the control loop about a stage are such blocks: its begin, its commanded start, its
samples, its end.
"""

import json
import struct
import zlib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from enum import IntEnum
from pathlib import Path
from typing import Any

import numpy as np

from rfca_rig.recording.columns import (
    HOST_TIME,
    ColumnForm,
    CommandedStart,
    Rows,
    StreamForm,
    pack_rows,
)
from rfca_rig.recording.model import StaticStage

# Mark, kind, a zero byte, length and CRC-32: 12 bytes, little endian (docs/recordings.md).
_HEAD = struct.Struct("<2sBxII")
_MARK = b"RB"
# Limit of a block's length: a length field above it is damage.
MAX_BLOCK_BYTES = 16 << 20
PIECE = 1 << 20


class BlockKind(IntEnum):
    """Kind of a block. All but SAMPLES are JSON."""

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


def frame_block(block: JournalBlock) -> bytes:
    """The block with its head: mark, kind, length and CRC-32, 12 bytes little endian. Raises
    ValueError for one above `MAX_BLOCK_BYTES`.
    """
    if len(block.payload) > MAX_BLOCK_BYTES:
        raise ValueError(f"a block of {len(block.payload)} bytes")
    return (
        _HEAD.pack(_MARK, block.kind, len(block.payload), _checksum(block.kind, block.payload))
        + block.payload
    )


def parse_blocks(content: bytes) -> tuple[list[JournalBlock], int]:
    """The blocks up to the first that is torn or damaged, and how many bytes they take."""
    blocks = list[JournalBlock]()
    view = memoryview(content)
    used = 0
    while len(view) - used >= _HEAD.size:
        mark, kind, length, checksum = _HEAD.unpack_from(view, used)
        payload = bytes(view[used + _HEAD.size : used + _HEAD.size + length])
        if (
            mark != _MARK
            or len(payload) != length
            or checksum != _checksum(kind, payload)
            or kind not in _KINDS
        ):
            break
        blocks.append(JournalBlock(BlockKind(kind), payload))
        used += block_size(blocks[-1])
    return blocks, used


def block_size(block: JournalBlock) -> int:
    """Size of a block in bytes, with its head."""
    return _HEAD.size + len(block.payload)


def read_blocks(path: Path) -> Iterator[JournalBlock]:
    """The whole blocks of a file of any length, with little of it in memory at a time. Raises
    OSError.
    """
    with path.open("rb") as file:
        remainder = b""
        while piece := file.read(PIECE):
            blocks, used = parse_blocks(remainder + piece)
            remainder = (remainder + piece)[used:]
            yield from blocks
            # A damaged block ends the journal: behind it there is no telling where the next one
            # begins.
            if not _may_go_on(remainder):
                return


def _may_go_on(remainder: bytes) -> bool:
    """Whether more bytes may complete the block whose beginning these are."""
    if len(remainder) < _HEAD.size:
        return True
    mark, kind, length, _ = _HEAD.unpack_from(remainder)
    return (
        mark == _MARK
        and kind in _KINDS
        and length <= MAX_BLOCK_BYTES
        and len(remainder) < _HEAD.size + length
    )


def _checksum(kind: int, payload: bytes) -> int:
    # Begun with the kind, so that a damaged kind is noticed too.
    return zlib.crc32(payload, kind)


@dataclass(frozen=True)
class Begin:
    """A stage begins; every sample is recorded from now on."""

    label: str
    height_m: float
    forms: tuple[StreamForm, ...]

    def block(self) -> JournalBlock:
        return _text(BlockKind.BEGIN, asdict(self))

    @staticmethod
    def of(block: JournalBlock) -> "Begin":
        """Raises ValueError, LookupError or TypeError for a block that no run wrote."""
        content = json.loads(block.payload)
        forms = []
        for form in content["forms"]:
            columns = tuple(ColumnForm(**column) for column in form["columns"])
            for column in columns:
                if np.dtype(column.dtype).kind not in "iuf":
                    raise ValueError(f"column {column.name} is of {column.dtype}, no number")
            forms.append(StreamForm(str(form["name"]), columns))
        return Begin(str(content["label"]), float(content["height_m"]), tuple(forms))


@dataclass(frozen=True)
class StrokeCondition:
    """Speed and repeat of a stage that was a stroke."""

    speed_rad_s: float
    repeat: int


@dataclass(frozen=True)
class End:
    """A stage ends: as a stroke, as a static stage, or cut short with the reason."""

    stroke: StrokeCondition | None = None
    static: StaticStage | None = None
    cut_short: str = ""

    def block(self) -> JournalBlock:
        return _text(BlockKind.END, asdict(self))

    @staticmethod
    def of(block: JournalBlock) -> "End":
        content = json.loads(block.payload)
        stroke = None
        if content["stroke"]:
            stroke = StrokeCondition(
                float(content["stroke"]["speed_rad_s"]), int(content["stroke"]["repeat"])
            )
        static = None
        if content["static"]:
            static = static_stage_of(content["static"])
        return End(stroke, static, str(content["cut_short"]))


def static_stage_of(fields: Mapping[str, Any]) -> StaticStage:
    """The stage from plain data, as `dataclasses.asdict` and JSON leave it."""
    # JSON has no tuples; the dataclass compares equal only with them.
    values: dict[str, Any] = {
        name: tuple(value) if isinstance(value, list) else value for name, value in fields.items()
    }
    return StaticStage(**values)


def start_block(start: CommandedStart) -> JournalBlock:
    return _text(BlockKind.START, asdict(start))


def start_of(block: JournalBlock) -> CommandedStart:
    content = json.loads(block.payload)
    offsets = dict(content["offsets"])
    # Journals of earlier versions shift the host's time to the start, too.
    offsets.pop(HOST_TIME, None)
    return CommandedStart(content["start_s"], offsets)


def samples_block(rows: Sequence[Rows]) -> JournalBlock:
    return JournalBlock(BlockKind.SAMPLES, pack_rows(rows))


def event_block(event: Mapping[str, object]) -> JournalBlock:
    """One line for `events.jsonl`."""
    return _text(BlockKind.EVENT, event)


def _text(kind: BlockKind, content: Mapping[str, object]) -> JournalBlock:
    return JournalBlock(kind, json.dumps(content, ensure_ascii=False).encode())
