"""Samples of a recorded stage, in memory or in a file, to be read in blocks of some thousands."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

import h5py
import numpy as np
from numpy.typing import NDArray

from rfca_rig.recording.columns import ROWS_PER_CHUNK, link_name, read_names, read_scale
from rfca_rig.recording.model import Source, Stream
from rfca_rig.recording.store import report_damage
from rfca_rig.recording.strokes import TIME, check_times, streams_in

Rows = NDArray[Any]


class Sliceable(Protocol):
    """One-dimensional numbers (m,), in memory or in a file of which a slice is read."""

    @property
    def dtype(self) -> np.dtype[Any]: ...

    def __len__(self) -> int: ...

    def __getitem__(self, rows: slice, /) -> Rows: ...


@dataclass(frozen=True)
class StoredColumn:
    """A column (m,). Its value in `unit` is raw * conversion + offset."""

    raw: Sliceable
    unit: str
    conversion: float
    offset: float

    @property
    def is_count(self) -> bool:
        """Whether it is a whole number without a scale, for instance a sequence number or a status word."""
        return self.raw.dtype.kind in "iu" and self.conversion == 1.0 and self.offset == 0.0

    def values(self, rows: slice) -> Rows:
        """Values (k,) of these rows in the column's unit; a count stays a whole number."""
        raw = self.raw[rows]
        # A count as a float would lose digits and its meaning.
        return raw.astype(np.int64) if self.is_count else raw.astype(np.float64) * self.conversion + self.offset


@dataclass(frozen=True)
class StoredStream:
    """Columns that share a time base (m,), which counts from the stage's commanded start."""

    name: str
    t_s: Sliceable
    columns: Mapping[str, StoredColumn]

    def blocks(self) -> Iterator[slice]:
        """All rows as consecutive slices."""
        # One chunk of the file at a time: HDF5 reads and unpacks whole chunks.
        for at in range(0, len(self.t_s), ROWS_PER_CHUNK):
            yield slice(at, at + ROWS_PER_CHUNK)


@dataclass(frozen=True)
class DatasetInFile:
    """Implements Sliceable for a dataset. Damage in what is read raises BadInput that names the file."""

    path: Path
    dataset: h5py.Dataset
    is_time: bool = False

    @property
    def dtype(self) -> np.dtype[Any]:
        found: np.dtype[Any] = self.dataset.dtype
        return found

    def __len__(self) -> int:
        return len(self.dataset)

    def __getitem__(self, rows: slice, /) -> Rows:
        """Values (k,) of these rows."""
        with report_damage(self.path):
            values = np.asarray(self.dataset[rows])
            if self.is_time:
                check_times(self.dataset.parent, values)
            return values


def streams_in_file(path: Path, stage: h5py.Group, source: Source) -> tuple[StoredStream, ...]:
    """Streams of a stage's group, valid while the file at `path` is open. Raises BadInput where they are damaged."""
    with report_damage(path):
        return tuple(
            StoredStream(
                name,
                DatasetInFile(path, group[TIME], is_time=True),
                {column: _column_in(path, group[link_name(column)]) for column in read_names(group.attrs["order"])},
            )
            for name, group in streams_in(stage, source)
        )


def _column_in(path: Path, dataset: h5py.Dataset) -> StoredColumn:
    return StoredColumn(DatasetInFile(path, dataset), *read_scale(dataset))


def streams_in_memory(streams: Mapping[str, Stream]) -> tuple[StoredStream, ...]:
    """The same for streams in memory."""
    return tuple(
        StoredStream(
            name, stream.t_s, {key: StoredColumn(one.raw, one.unit, one.conversion, one.offset) for key, one in stream.columns.items()}
        )
        for name, stream in streams.items()
    )
