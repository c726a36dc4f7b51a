"""Messages of an MCAP file: samples as Protocol Buffers, everything else as JSON for Foxglove and
Lichtblick.

JSON messages for everything except samples: log, pictures, stages. Log and pictures use the schema
names that Foxglove knows.

Samples encoded as Protocol Buffers, one message per record, some thousand messages at a time.

Every field has a fixed width (double, sfixed64). All messages of a stream are therefore equally
long, and numpy writes them as one array.
"""

import base64
import json
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from math import isnan
from pathlib import Path
from typing import Any

import numpy as np
from google.protobuf.descriptor_pb2 import (
    DescriptorProto,
    FieldDescriptorProto,
    FileDescriptorProto,
    FileDescriptorSet,
)

from rfca_rig.campaign.stored import StoredStream
from rfca_rig.drivers.photo_files import read_picture_bytes

NS = 1_000_000_000
# Values of the enumeration in Foxglove's Log schema: 1 debug, 2 info, 3 warning, 4 error, 5 fatal.
LEVELS = {"info": 2, "warning": 3, "error": 4}
FORMATS = {".png": "png", ".jpg": "jpeg", ".jpeg": "jpeg"}

_TIME = {
    "type": "object",
    "title": "time",
    "properties": {"sec": {"type": "integer", "minimum": 0}, "nsec": {"type": "integer"}},
}
_TEXT = {"type": "string"}
_NUMBER = {"type": "number"}

PACKAGE = "rfca_rig"
TIME = "t_s"
# Wire type I64 of the Protocol Buffers encoding, for double and sfixed64.
FIXED_64 = 1


def _schema(name: str, /, **properties: Mapping[str, Any]) -> tuple[str, bytes]:
    return name, json.dumps({"title": name, "type": "object", "properties": properties}).encode()


LOG = _schema(
    "foxglove.Log",
    timestamp=_TIME,
    level={"type": "integer"},
    message=_TEXT,
    name=_TEXT,
    file=_TEXT,
    line={"type": "integer", "minimum": 0},
)
IMAGE = _schema(
    "foxglove.CompressedImage",
    timestamp=_TIME,
    frame_id=_TEXT,
    data={"type": "string", "contentEncoding": "base64"},
    format=_TEXT,
)
STAGE = _schema(
    "rfca_rig.Stage",
    label=_TEXT,
    height_mm=_NUMBER,
    speed_rad_s=_NUMBER,
    repeat={"type": "integer"},
    cut_short=_TEXT,
)
STATIC = _schema(
    "rfca_rig.StaticStage",
    stage={"type": "integer"},
    direction=_TEXT,
    **dict.fromkeys(("height_mm", "shaft_angle_rad", "fy_N", "fz_N", "tx_Nm"), _NUMBER),
    **{f"hinge{i}_deg": {"type": ["number", "null"]} for i in range(2, 8)},
)


def log(ns: int, message: str, level: str = "info") -> bytes:
    """A foxglove.Log message of one line at `ns` nanoseconds of UTC; `level` is a key of LEVELS."""
    return _json(
        timestamp=_time(ns), level=LEVELS[level], message=message, name="rfca-rig", file="", line=0
    )


def image(ns: int, path: Path) -> bytes:
    """A foxglove.CompressedImage message with the bytes of the file, base64 as JSON needs.
    Raises BadInput where it cannot be read.
    """
    data = base64.b64encode(read_picture_bytes(path)).decode()
    return _json(
        timestamp=_time(ns), frame_id="camera", data=data, format=FORMATS[path.suffix.lower()]
    )


def values(**named: Any) -> bytes:
    """A message of plain values by name. JSON has no NaN: it becomes null."""
    return _json(
        **{
            name: None if isinstance(value, float) and isnan(value) else value
            for name, value in named.items()
        }
    )


def _json(**content: Any) -> bytes:
    # allow_nan=False: Python would write the bare word NaN, which other JSON parsers reject.
    return json.dumps(content, ensure_ascii=False, allow_nan=False).encode()


def _time(ns: int) -> dict[str, int]:
    return {"sec": ns // NS, "nsec": ns % NS}


@dataclass(frozen=True)
class Layout:
    """Fields of one stream's messages in order, each with True for a whole number (sfixed64) and
    False for a double.
    """

    name: str
    fields: tuple[tuple[str, bool], ...]

    @property
    def _message(self) -> str:
        return field_names([self.name])[0].capitalize()

    @property
    def type_name(self) -> str:
        return f"{PACKAGE}.{self._message}"

    @property
    def descriptor(self) -> bytes:
        """Serialized FileDescriptorSet, which MCAP requires as the schema of a protobuf channel."""
        file = FileDescriptorProto(
            name=f"{PACKAGE}/{self.name}.proto", package=PACKAGE, syntax="proto3"
        )
        message = DescriptorProto(name=self._message)
        for number, (name, is_count) in enumerate(self.fields, start=1):
            if is_count:
                kind = FieldDescriptorProto.TYPE_SFIXED64
            else:
                kind = FieldDescriptorProto.TYPE_DOUBLE
            message.field.append(
                FieldDescriptorProto(
                    name=name, number=number, type=kind, label=FieldDescriptorProto.LABEL_OPTIONAL
                )
            )
        file.message_type.append(message)
        return bytes(FileDescriptorSet(file=[file]).SerializeToString())

    @property
    def dtype(self) -> np.dtype[np.void]:
        """Structured type of one message: for each field its tag bytes, then 8 bytes of value,
        little-endian.
        """
        parts: list[tuple[str, str]] = []
        for number, (name, is_count) in enumerate(self.fields, start=1):
            # Tags are of type void, because a tag takes one byte up to field 15 and two bytes
            # above.
            parts += [
                (f"tag {name}", f"V{len(_tag(number))}"),
                (name, "<i8" if is_count else "<f8"),
            ]
        return np.dtype(parts)

    def empty_messages(self, rows: int) -> np.ndarray:
        """Array (rows,) of messages of type `dtype`: tags filled in, values zero."""
        messages = np.zeros(rows, self.dtype)
        for number, (name, _) in enumerate(self.fields, start=1):
            messages[f"tag {name}"] = np.void(_tag(number))
        return messages


def layout_of(stream: StoredStream) -> Layout:
    """Layout of a stream: time first, then its columns, with names that Protocol Buffers allow."""
    names = field_names((TIME, *stream.columns))
    counts = (False, *(column.is_count for column in stream.columns.values()))
    return Layout(stream.name, tuple(zip(names, counts, strict=True)))


def field_names(names: Sequence[str]) -> list[str]:
    """Names with letters, digits and underscores only, no two alike. Columns of imported
    spreadsheets may have any name.
    """
    fields: list[str] = []
    for name in names:
        plain = re.sub(r"[^0-9A-Za-z_]", "_", name)
        if not plain or plain[0].isdigit():
            plain = f"_{plain}"
        if plain in fields:
            plain = f"{plain}_{len(fields)}"
        fields.append(plain)
    return fields


def pack_samples(stream: StoredStream, layout: Layout) -> Iterator[tuple[np.ndarray, memoryview]]:
    """Encodes a stream block by block.

    Yields
    ------
    t_s, content
        Times (m,) in s from the stage's commanded start, and the bytes of m messages of
        `layout.dtype.itemsize` bytes each.
    """
    for rows in stream.blocks():
        t_s = np.asarray(stream.t_s[rows], dtype=np.float64)
        messages = layout.empty_messages(len(t_s))
        values = (t_s, *(column.values(rows) for column in stream.columns.values()))
        # Assignment to a field of the structured array writes one column of all messages at once.
        for (name, _), some in zip(layout.fields, values, strict=True):
            messages[name] = some
        yield t_s, memoryview(messages.tobytes())


def _tag(number: int) -> bytes:
    """Field number and wire type as a varint: seven bits a byte, the lowest first, the top bit
    set on all but the last.
    """
    rest = number << 3 | FIXED_64
    tag = b""
    while rest > 0x7F:
        tag = tag + bytes([rest & 0x7F | 0x80])
        rest = rest >> 7
    return tag + bytes([rest])
