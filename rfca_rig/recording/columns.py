"""A column as an HDF5 dataset: physical values in the unit that `units` names.

Samples on their way to the disk are rows of packed records, one kind of record per device, with
counts as the device sent them. They become values when a stage ends. Files of the first format hold
the counts and a scale, which is applied when they are read.
"""

import json
import math
import re
import struct
import urllib.parse
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import h5py
import numpy as np
from numpy.typing import NDArray

from rfca_rig.recording.model import Column, Floats, Stream

Rows = NDArray[Any]

FORMAT = "rfca-recording/2"
FORMAT_OF_COUNTS = "rfca-recording/1"

# every device has both
HOST_TIME = "host_s"
DEVICE_TIME = "device_s"
_COUNT = struct.Struct("<I")

# Rows that are compressed, written and copied at a time.
ROWS_PER_CHUNK = 16384

# Values of counts are rounded to the nearest multiple of a power of two, at most this part of a
# count: the last binary digits are zero then, which compresses to 1.1 times the size of the counts
# instead of 2.2. An eighth of a count is lost at most, so rounding gives the count back.
ROUNDING_COUNTS = 0.25

_LONG_NAMES = {
    "t_s": "time since the commanded start, from the device's sample counter",
    "host_s": "time of arrival, by the clock of the run",
    "shaft_angle_rad": "shaft angle from the horizontal, positive downwards",
    "shaft_speed_rad_s": "shaft speed",
    "motor_torque_Nm": "motor torque at the shaft",
    "fx_N": "force along the shaft",
    "fy_N": "force along the ground",
    "fz_N": "vertical force, sensor axis down",
    "tx_Nm": "torque about the shaft's direction, at the sensor",
    "ty_Nm": "torque about the direction along the ground, at the sensor",
    "tz_Nm": "torque about the vertical, at the sensor",
}


@dataclass(frozen=True)
class ColumnForm:
    """Layout of one column of packed records; its value in `unit` is raw * conversion + offset.
    `dtype` in NumPy's notation, for example "<i4".
    """

    name: str
    dtype: str
    unit: str
    conversion: float = 1.0
    offset: float = 0.0

    @property
    def is_physical(self) -> bool:
        """Whether the records hold the values themselves."""
        return self.conversion == 1.0 and self.offset == 0.0

    @property
    def stored_dtype(self) -> np.dtype[Any]:
        """Of the values."""
        if self.is_physical:
            return np.dtype(self.dtype)
        return np.dtype(np.float64)

    def values(self, raw: Rows) -> Rows:
        """Values (m,) in the unit, of `stored_dtype`, from the column's part (m,) of records.

        Order: exact where the records hold values; else one rounding of floating-point numbers, and
        for counts half of `ROUNDING_COUNTS`.
        """
        if self.is_physical:
            return raw
        if raw.dtype.kind == "f":
            return raw * np.float64(self.conversion) + self.offset
        step = 2.0 ** math.floor(math.log2(ROUNDING_COUNTS * abs(self.conversion)))
        # Division by a power of two is exact.
        steps: Floats = raw * np.float64(self.conversion / step) + self.offset / step
        np.rint(steps, out=steps)
        steps *= step
        return steps


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
    """Host time of the commanded start, and offsets of columns, by name, that replace those of
    their form.
    """

    start_s: float
    offsets: Mapping[str, float] = field(default_factory=dict)


def pack_rows(rows: Sequence[Rows]) -> bytes:
    """Packs the rows of all streams, each (m,) of its form's records, in the order of their
    forms: a count (4 bytes), then the records.
    """
    # A count per stream, because each device brings its own number of records per tick.
    return b"".join(_COUNT.pack(len(some)) + some.tobytes() for some in rows)


class RowBatches:
    """Gathers the rows of a stage's blocks into batches of `rows` each, per stream; only the
    remainder is shorter.
    """

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
        # The checksum of the block was right, so this is a mistake of the writer; reading on would
        # shift every record.
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
        self._pieces[stream] = [remainder]
        self._gathered[stream] = len(remainder)

    def rest(self) -> Iterator[tuple[int, Rows]]:
        """The remainder of each stream, (n,) records with n below a full batch, with the number
        of the stream.
        """
        for stream in range(len(self._dtypes)):
            yield stream, self._join_rows(stream)

    def _join_rows(self, stream: int) -> Rows:
        return np.frombuffer(b"".join(self._pieces[stream]), self._dtypes[stream])


def make_stream_from_rows(form: StreamForm, rows: Rows, start: CommandedStart) -> Stream:
    """Stream from rows (m,) of records: a column (m,) for each of the form, with time from the
    device's own counter.
    """
    columns = {}
    for column in apply_start(form, start).columns:
        values = np.ascontiguousarray(column.values(rows[column.name]))
        columns[column.name] = Column(values, column.unit)
    if len(rows):
        offset_s = host_offset_s(rows[HOST_TIME], rows[DEVICE_TIME])
    else:
        offset_s = 0.0
    return Stream(rows[DEVICE_TIME] + (offset_s - start.start_s), columns)


def apply_start(form: StreamForm, start: CommandedStart) -> StreamForm:
    """The form with the offsets that depend on the commanded start."""
    return replace(
        form,
        columns=tuple(
            replace(column, offset=start.offsets.get(column.name, column.offset))
            for column in form.columns
        ),
    )


def host_offset_s(host_s: Floats, device_s: Floats) -> float:
    """Seconds to add to a device's own time to get the host's: the smallest delay is the best
    estimate of none.

    Bias: late by the shortest delay from device to host. On CAN that is the time on the wire where
    the bus stamps its frames, else up to one period of the reports; on a local network well below a
    millisecond.

    Parameters
    ----------
    host_s, device_s : ndarray, shape (m,)
        Times of arrival and times by the device's counter, in s; m is at least 1.

    Returns
    -------
    float
        Offset in s.
    """
    # Delays are only ever positive, so a mean would depend on the load of the computer; the minimum
    # does not.
    return float(np.min(host_s - device_s))


def make_column(group: h5py.Group, form: ColumnForm, length: int) -> h5py.Dataset:
    """One 1-d dataset without values yet, compressed so that it opens everywhere without
    plugins.
    """
    storage: dict[str, Any] = {}
    # gzip at its fastest, with shuffle; HDF5 allows no chunks in an empty dataset.
    if length:
        storage = {
            "chunks": (min(length, ROWS_PER_CHUNK),),
            "compression": "gzip",
            "compression_opts": 1,
            "shuffle": True,
        }
    dataset = group.create_dataset(
        link_name(form.name), shape=(length,), dtype=form.stored_dtype, track_times=False, **storage
    )
    dataset.attrs["units"] = form.unit
    dataset.attrs["long_name"] = _LONG_NAMES.get(form.name, form.name)
    return dataset


def column_form_of(name: str, column: Column) -> ColumnForm:
    """Layout of a column in memory. Raises ValueError where it is no 1-d array of numbers."""
    if column.data.ndim != 1 or column.data.dtype.kind not in "iuf":
        raise ValueError(
            f"column {name} must be a row of numbers, not {column.data.ndim}-d {column.data.dtype}"
        )
    return ColumnForm(name, column.data.dtype.str, column.unit)


def write_column(group: h5py.Group, name: str, column: Column) -> h5py.Dataset:
    """One 1-d dataset with its values. Raises ValueError where the column is no 1-d array of
    numbers.
    """
    dataset = make_column(group, column_form_of(name, column), len(column.data))
    if len(column.data):
        dataset[:] = np.ascontiguousarray(column.data)
    return dataset


def read_form(group: h5py.Group, name: str) -> ColumnForm:
    """Layout of a stored column. Raises ValueError where its scale, which only files of the first
    format have, makes no values.
    """
    dataset = check_column(group, name)
    unit = str(dataset.attrs["units"])
    if not is_of_counts(group):
        return ColumnForm(name, dataset.dtype.str, unit)
    conversion = float(dataset.attrs["conversion"])
    offset = float(dataset.attrs["offset"])
    if not (math.isfinite(conversion) and conversion and math.isfinite(offset)):
        raise ValueError(
            f"{dataset.name} has the conversion {conversion} and the offset {offset}, "
            "which are to be finite numbers, the conversion not 0"
        )
    # The first format shifted this time to the commanded start, from which `t_s` counts.
    if name == HOST_TIME:
        offset = 0.0
    return ColumnForm(name, dataset.dtype.str, unit, conversion, offset)


def read_names(text: object) -> list[str]:
    """The names in an attribute, in their order. Raises ValueError where it is no list of
    different names.
    """
    names = None
    if isinstance(text, str):
        names = json.loads(text)
    if not (
        isinstance(names, list)
        and all(isinstance(name, str) for name in names)
        and len(set(names)) == len(names)
    ):
        raise ValueError(f"{str(text)[:60]!r} is no list of different names")
    return names


def check_column(group: h5py.Group, name: str) -> h5py.Dataset:
    """The dataset of a column. Raises ValueError where it is no row of numbers."""
    dataset = group.get(link_name(name))
    if (
        not isinstance(dataset, h5py.Dataset)
        or dataset.ndim != 1
        or dataset.dtype.kind not in "iuf"
    ):
        raise ValueError(f"{group.name}/{name} is no row of numbers")
    return dataset


def is_of_counts(group: h5py.Group) -> bool:
    """Whether the group's file is of the first format."""
    return bool(group.file.attrs["format"] == FORMAT_OF_COUNTS)


def copy_column(source: h5py.Group, target: h5py.Group, name: str) -> h5py.h5d.DatasetID:
    """Copies a column into another file, with its attributes and its chunks as they are packed."""
    link = link_name(name).encode()
    h5py.h5o.copy(source.id, link, target.id, link)
    copied = h5py.h5d.open(target.id, link)
    # What connects columns with their times refers to places in the file that it comes from.
    for attribute in (b"DIMENSION_LIST", b"REFERENCE_LIST"):
        if h5py.h5a.exists(copied, attribute):
            h5py.h5a.delete(copied, attribute)
    return copied


def read_column(group: h5py.Group, name: str) -> Column:
    """One column. Raises ValueError as `read_form`."""
    form = read_form(group, name)
    return Column(form.values(group[link_name(name)][:]), form.unit)


def link_name(name: str) -> str:
    """The name as an HDF5 link, in which "/" and a lone "." would be read as a path."""
    escaped = re.sub("[%/]", lambda match: urllib.parse.quote(match[0], safe=""), name)
    if set(escaped) == {"."}:
        return escaped.replace(".", "%2E")
    return escaped
