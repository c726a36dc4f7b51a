"""Samples on their way to the disk: rows of packed records, one kind of record per device, and what turns them into streams."""

import struct
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rfca_rig.recording.model import Column, Floats, Stream

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
class CommandedStart:
    """The commanded start: its host time, and what takes the place of the offset of columns, by name."""

    start_s: float
    offsets: Mapping[str, float] = field(default_factory=dict)


def packed(rows: Sequence[Rows]) -> bytes:
    """The rows of all streams, in the order of their forms, as one piece of bytes."""
    return b"".join(_COUNT.pack(len(some)) + some.tobytes() for some in rows)


class RowBatches:
    """Gathers the rows of a stage's blocks to batches of `rows` each, per stream; only what is left over is shorter."""

    def __init__(self, forms: Sequence[StreamForm], rows: int) -> None:
        self._dtypes = [form.dtype for form in forms]
        self._rows = rows
        self._pieces: list[list[bytes]] = [[] for _ in forms]
        self._gathered = [0] * len(forms)

    def add(self, content: bytes) -> Iterator[tuple[int, Rows]]:
        """What `packed` gave; yields the batches that become full by it, each with the number of its stream.

        Raises ValueError where the content is not such.
        """
        at = 0
        for stream, dtype in enumerate(self._dtypes):
            end = at + _COUNT.size + dtype.itemsize * _COUNT.unpack_from(content, at)[0]
            self._pieces[stream].append(content[at + _COUNT.size : end])
            self._gathered[stream] += end - at - _COUNT.size
            at = end
        if at != len(content):
            raise ValueError(f"{len(content)} bytes of samples, where their counts make {at}")
        for stream, dtype in enumerate(self._dtypes):
            if self._gathered[stream] >= self._rows * dtype.itemsize:
                yield from self._full(stream)

    def _full(self, stream: int) -> Iterator[tuple[int, Rows]]:
        rows = self._taken(stream)
        whole = len(rows) // self._rows * self._rows
        for at in range(0, whole, self._rows):
            yield stream, rows[at : at + self._rows]
        left = rows[whole:].tobytes()
        self._pieces[stream], self._gathered[stream] = [left], len(left)

    def rest(self) -> Iterator[tuple[int, Rows]]:
        """What is left over of each stream."""
        for stream in range(len(self._dtypes)):
            yield stream, self._taken(stream)

    def _taken(self, stream: int) -> Rows:
        return np.frombuffer(b"".join(self._pieces[stream]), self._dtypes[stream])


def stream_of(form: StreamForm, rows: Rows, start: CommandedStart) -> Stream:
    """The rows as columns, with their time from the device's own counter."""
    columns = {
        column.name: Column(np.ascontiguousarray(rows[column.name]), column.unit, column.conversion, column.offset)
        for column in started(form, start).columns
    }
    return Stream(_device_time(rows, start.start_s), columns)


def started(form: StreamForm, start: CommandedStart) -> StreamForm:
    """The form with the offsets that the commanded start decides."""
    return replace(form, columns=tuple(replace(column, offset=start.offsets.get(column.name, column.offset)) for column in form.columns))


def _device_time(rows: Rows, start_s: float) -> Floats:
    if not len(rows):
        return np.zeros(0)
    return rows[DEVICE_TIME] + (host_offset_s(rows[HOST_TIME], rows[DEVICE_TIME]) - start_s)


def host_offset_s(host_s: Floats, device_s: Floats) -> float:
    """What to add to a device's own time to get the host's: the least delay seen is nearest to none.

    Bias: late by the shortest way from device to host, which is well below a millisecond on CAN and on a local network.
    """
    return float(np.min(host_s - device_s))
