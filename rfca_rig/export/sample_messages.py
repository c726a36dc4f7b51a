"""Samples encoded as Protocol Buffers, one message per record, some thousand messages at a time.

Every field has a fixed width (double, sfixed64). All messages of a stream are therefore equally long, and numpy writes them as one array.
"""

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from google.protobuf.descriptor_pb2 import DescriptorProto, FieldDescriptorProto, FileDescriptorProto, FileDescriptorSet

from rfca_rig.campaign.stored import StoredStream

PACKAGE = "rfca_rig"
TIME = "t_s"
# Wire type I64 of the Protocol Buffers encoding, for double and sfixed64.
FIXED_64 = 1


@dataclass(frozen=True)
class Layout:
    """Fields of one stream's messages in order, each with True for a whole number (sfixed64) and False for a double."""

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
        file = FileDescriptorProto(name=f"{PACKAGE}/{self.name}.proto", package=PACKAGE, syntax="proto3")
        message = DescriptorProto(name=self._message)
        for number, (name, is_count) in enumerate(self.fields, start=1):
            kind = FieldDescriptorProto.TYPE_SFIXED64 if is_count else FieldDescriptorProto.TYPE_DOUBLE
            message.field.append(FieldDescriptorProto(name=name, number=number, type=kind, label=FieldDescriptorProto.LABEL_OPTIONAL))
        file.message_type.append(message)
        return bytes(FileDescriptorSet(file=[file]).SerializeToString())

    @property
    def dtype(self) -> np.dtype[np.void]:
        """Structured type of one message: for each field its tag bytes, then 8 bytes of value, little-endian."""
        parts: list[tuple[str, str]] = []
        for number, (name, is_count) in enumerate(self.fields, start=1):
            # Tags are of type void, because a tag takes one byte up to field 15 and two bytes above.
            parts += [(f"tag {name}", f"V{len(_tag(number))}"), (name, "<i8" if is_count else "<f8")]
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
    """Names with letters, digits and underscores only, no two alike. Columns of imported spreadsheets may have any name."""
    fields: list[str] = []
    for name in names:
        plain = re.sub(r"[^0-9A-Za-z_]", "_", name)
        plain = f"_{plain}" if not plain or plain[0].isdigit() else plain
        fields.append(plain if plain not in fields else f"{plain}_{len(fields)}")
    return fields


def pack_samples(stream: StoredStream, layout: Layout) -> Iterator[tuple[np.ndarray, memoryview]]:
    """Encodes a stream block by block.

    Yields
    ------
    t_s, content
        Times (m,) in s from the stage's commanded start, and the bytes of m messages of `layout.dtype.itemsize` bytes each.
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
    """Field number and wire type as a varint: seven bits a byte, the lowest first, the top bit set on all but the last."""
    rest, tag = number << 3 | FIXED_64, b""
    while rest > 0x7F:
        tag, rest = tag + bytes([rest & 0x7F | 0x80]), rest >> 7
    return tag + bytes([rest])
