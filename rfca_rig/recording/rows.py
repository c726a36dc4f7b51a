"""Samples on their way to the disk: rows of packed records, one kind of record per device, and what turns them into streams."""

import struct
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rfca_rig.recording.form import Column, Floats, Stream

Rows = NDArray[Any]

HOST_TIME, DEVICE_TIME = "host_s", "device_s"  # every device has both
_COUNT = struct.Struct("<I")


@dataclass(frozen=True)
class ColumnForm:
    """One column as the device gives it; its value in `unit` is raw * conversion + offset. `dtype` as numpy writes it, such as "<i4"."""

    name: str
    dtype: str
    unit: str
    conversion: float = 1.0
    offset: float = 0.0


@dataclass(frozen=True)
class StreamForm:
    """The columns of one device, in their order."""

    name: str
    columns: tuple[ColumnForm, ...]

    @property
    def dtype(self) -> np.dtype[Any]:
        """Of one record, packed."""
        return np.dtype([(column.name, column.dtype) for column in self.columns])


@dataclass(frozen=True)
class Start:
    """The commanded start: its host time, and what takes the place of the offset of columns, by name."""

    start_s: float
    offsets: Mapping[str, float] = field(default_factory=dict)


def packed(rows: Sequence[Rows]) -> bytes:
    """The rows of all streams, in the order of their forms, as one piece of bytes."""
    return b"".join(_COUNT.pack(len(some)) + some.tobytes() for some in rows)


class RowPile:
    """Puts the pieces of a stage one after the other."""

    def __init__(self, forms: Sequence[StreamForm]) -> None:
        self._forms = forms
        self._sizes = [form.dtype.itemsize for form in forms]
        self._pieces: list[list[bytes]] = [[] for _ in forms]

    def add(self, content: bytes) -> None:
        """What `packed` gave. Raises ValueError where the content is not such."""
        at = 0
        for size, pieces in zip(self._sizes, self._pieces, strict=True):
            end = at + _COUNT.size + size * _COUNT.unpack_from(content, at)[0]
            pieces.append(content[at + _COUNT.size : end])
            at = end
        if at != len(content):
            raise ValueError(f"{len(content)} bytes of samples, where their counts make {at}")

    def streams(self, start: Start | None) -> dict[str, Stream]:
        """All streams by name; without a commanded start, time counts from the first sample of all."""
        rows = [np.frombuffer(b"".join(pieces), form.dtype) for form, pieces in zip(self._forms, self._pieces, strict=True)]
        known = start or Start(min((float(some[HOST_TIME][0]) for some in rows if len(some)), default=0.0))
        return {form.name: stream_of(form, some, known) for form, some in zip(self._forms, rows, strict=True)}


def stream_of(form: StreamForm, rows: Rows, start: Start) -> Stream:
    """The rows as columns, with their time from the device's own counter."""
    columns = {
        column.name: Column(
            np.ascontiguousarray(rows[column.name]), column.unit, column.conversion, start.offsets.get(column.name, column.offset)
        )
        for column in form.columns
    }
    return Stream(_device_time(rows, start.start_s), columns)


def _device_time(rows: Rows, start_s: float) -> Floats:
    if not len(rows):
        return np.zeros(0)
    return rows[DEVICE_TIME] + (host_offset_s(rows[HOST_TIME], rows[DEVICE_TIME]) - start_s)


def host_offset_s(host_s: Floats, device_s: Floats) -> float:
    """What to add to a device's own time to get the host's: the least delay seen is nearest to none.

    Bias: late by the shortest way from device to host, which is well below a millisecond on CAN and on a local network.
    """
    return float(np.min(host_s - device_s))
