"""Samples on their way to the disk: rows of packed records, one kind of record per device, and their conversion to streams."""

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
    """Layout of one column; its value in `unit` is raw * conversion + offset. `dtype` in NumPy's notation, for example "<i4"."""

    name: str
    dtype: str
    unit: str
    conversion: float = 1.0
    offset: float = 0.0


@dataclass(frozen=True)
class StreamForm:
    """Layout of one device's records: its columns in their order."""

    name: str
    columns: tuple[ColumnForm, ...]

    @property
    def dtype(self) -> np.dtype[Any]:
        """Of one packed record."""
        return np.dtype([(column.name, column.dtype) for column in self.columns])


@dataclass(frozen=True)
class CommandedStart:
    """Host time of the commanded start, and offsets of columns, by name, that replace those of their form."""

    start_s: float
    offsets: Mapping[str, float] = field(default_factory=dict)


def pack_rows(rows: Sequence[Rows]) -> bytes:
    """Packs the rows of all streams, each (m,) of its form's records, in the order of their forms: a count (4 bytes), then the records."""
    # A count per stream, because each device brings its own number of records per tick.
    return b"".join(_COUNT.pack(len(some)) + some.tobytes() for some in rows)


class RowBatches:
    """Gathers the rows of a stage's blocks into batches of `rows` each, per stream; only the remainder is shorter."""

    def __init__(self, forms: Sequence[StreamForm], rows: int) -> None:
        self._dtypes = [form.dtype for form in forms]
        self._rows = rows
        self._pieces: list[list[bytes]] = [[] for _ in forms]
        self._gathered = [0] * len(forms)

    def add(self, content: bytes) -> Iterator[tuple[int, Rows]]:
        """Adds what `pack_rows` returned; yields the batches that it completes.

        Yields
        ------
        tuple of int and ndarray, shape (rows,)
            Number of the stream, and a full batch of its records.

        Raises
        ------
        ValueError
            The content is no packed rows.
        """
        at = 0
        for stream, dtype in enumerate(self._dtypes):
            end = at + _COUNT.size + dtype.itemsize * _COUNT.unpack_from(content, at)[0]
            self._pieces[stream].append(content[at + _COUNT.size : end])
            self._gathered[stream] += end - at - _COUNT.size
            at = end
        # The checksum of the block was right, so this is a mistake of the writer; reading on would shift every
        # record.
        if at != len(content):
            raise ValueError(f"{len(content)} bytes of samples, where their counts make {at}")
        for stream, dtype in enumerate(self._dtypes):
            if self._gathered[stream] >= self._rows * dtype.itemsize:
                yield from self._full(stream)

    def _full(self, stream: int) -> Iterator[tuple[int, Rows]]:
        rows = self._join_rows(stream)
        complete = len(rows) // self._rows * self._rows
        for at in range(0, complete, self._rows):
            yield stream, rows[at : at + self._rows]
        # A copy: the remainder must not keep the whole joined buffer in memory.
        remainder = rows[complete:].tobytes()
        self._pieces[stream], self._gathered[stream] = [remainder], len(remainder)

    def rest(self) -> Iterator[tuple[int, Rows]]:
        """The remainder of each stream, (n,) records with n below a full batch, with the number of the stream."""
        for stream in range(len(self._dtypes)):
            yield stream, self._join_rows(stream)

    def _join_rows(self, stream: int) -> Rows:
        return np.frombuffer(b"".join(self._pieces[stream]), self._dtypes[stream])


def make_stream_from_rows(form: StreamForm, rows: Rows, start: CommandedStart) -> Stream:
    """Stream from rows (m,) of records: a column (m,) for each of the form, with time from the device's own counter."""
    columns = {
        column.name: Column(np.ascontiguousarray(rows[column.name]), column.unit, column.conversion, column.offset)
        for column in apply_start(form, start).columns
    }
    return Stream(_device_time(rows, start.start_s), columns)


def apply_start(form: StreamForm, start: CommandedStart) -> StreamForm:
    """The form with the offsets that depend on the commanded start."""
    return replace(form, columns=tuple(replace(column, offset=start.offsets.get(column.name, column.offset)) for column in form.columns))


def _device_time(rows: Rows, start_s: float) -> Floats:
    if not len(rows):
        return np.zeros(0)
    return rows[DEVICE_TIME] + (host_offset_s(rows[HOST_TIME], rows[DEVICE_TIME]) - start_s)


def host_offset_s(host_s: Floats, device_s: Floats) -> float:
    """Seconds to add to a device's own time to get the host's: the smallest delay is the best estimate of none.

    Bias: late by the shortest delay from device to host, which is well below a millisecond on CAN and on a local network.

    Parameters
    ----------
    host_s, device_s : ndarray, shape (m,)
        Times of arrival and times by the device's counter, in s; m is at least 1.

    Returns
    -------
    float
        Offset in s.
    """
    # Delays are only ever positive, so a mean would depend on the load of the computer; the minimum does not.
    return float(np.min(host_s - device_s))
