"""Samples as Protocol Buffers, a message per record, packed some thousand at a time.

Every field has a fixed width (double, sfixed64), so that all messages of a stream are equally long and numpy lays them out at once.
"""

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from google.protobuf.descriptor_pb2 import DescriptorProto, FieldDescriptorProto, FileDescriptorProto, FileDescriptorSet

from rfca_rig.campaign.stored_streams import StoredStream

PACKAGE = "rfca_rig"
TIME = "t_s"
FIXED_64 = 1  # the wire type of both


@dataclass(frozen=True)
class Layout:
    """The fields of one stream's messages in their order, `True` for a whole number."""

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
        """A FileDescriptorSet, as readers of MCAP want it."""
        file = FileDescriptorProto(name=f"{PACKAGE}/{self.name}.proto", package=PACKAGE, syntax="proto3")
        message = DescriptorProto(name=self._message)
        for number, (name, is_count) in enumerate(self.fields, start=1):
            kind = FieldDescriptorProto.TYPE_SFIXED64 if is_count else FieldDescriptorProto.TYPE_DOUBLE
            message.field.append(FieldDescriptorProto(name=name, number=number, type=kind, label=FieldDescriptorProto.LABEL_OPTIONAL))
        file.message_type.append(message)
        return bytes(FileDescriptorSet(file=[file]).SerializeToString())

    @property
    def dtype(self) -> np.dtype[np.void]:
        """One message: each value behind its tag."""
        parts: list[tuple[str, str]] = []
        for number, (name, is_count) in enumerate(self.fields, start=1):
            parts += [(f"tag {name}", f"V{len(_tag(number))}"), (name, "<i8" if is_count else "<f8")]
        return np.dtype(parts)

    def blank(self, rows: int) -> np.ndarray:
        """That many messages without values."""
        messages = np.zeros(rows, self.dtype)
        for number, (name, _) in enumerate(self.fields, start=1):
            messages[f"tag {name}"] = np.void(_tag(number))
        return messages


def layout_of(stream: StoredStream) -> Layout:
    """Columns by their own names, as far as a field may be called so."""
    names = field_names((TIME, *stream.columns))
    counts = (False, *(column.is_count for column in stream.columns.values()))
    return Layout(stream.name, tuple(zip(names, counts, strict=True)))


def field_names(names: Sequence[str]) -> list[str]:
    """Letters, digits and underscores only, no two alike: a spreadsheet's column may be called anything."""
    found: list[str] = []
    for name in names:
        plain = re.sub(r"[^0-9A-Za-z_]", "_", name)
        plain = f"_{plain}" if not plain or plain[0].isdigit() else plain
        found.append(plain if plain not in found else f"{plain}_{len(found)}")
    return found


def packed_samples(stream: StoredStream, layout: Layout) -> Iterator[tuple[np.ndarray, memoryview]]:
    """Blocks of times (m,) and of m messages, one behind the other."""
    for rows in stream.blocks():
        t_s = np.asarray(stream.t_s[rows], dtype=np.float64)
        messages = layout.blank(len(t_s))
        values = (t_s, *(column.values(rows) for column in stream.columns.values()))
        for (name, _), some in zip(layout.fields, values, strict=True):
            messages[name] = some
        yield t_s, memoryview(messages.tobytes())


def _tag(number: int) -> bytes:
    """Field number and wire type as a varint."""
    rest, tag = number << 3 | FIXED_64, b""
    while rest > 0x7F:
        tag, rest = tag + bytes([rest & 0x7F | 0x80]), rest >> 7
    return tag + bytes([rest])
