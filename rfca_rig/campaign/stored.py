"""Opens a recording stage by stage, so that hours of it need only the memory of the part in use.

Samples of a stage are in memory or still in their file, from which they are read in blocks of some
thousands.
"""

from collections.abc import Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, contextmanager, nullcontext
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Protocol

import h5py
import numpy as np
from numpy.typing import NDArray

from rfca_rig.campaign.opening import RECORDING_NAME, open_recordings, open_unsealed
from rfca_rig.protocol.plan import flap_label
from rfca_rig.recording import run_folder
from rfca_rig.recording.columns import (
    ROWS_PER_CHUNK,
    ColumnForm,
    link_name,
    read_form,
    read_names,
)
from rfca_rig.recording.hdf5_file import SEALED
from rfca_rig.recording.layout import refuse_links, stage_files
from rfca_rig.recording.model import Recording, Source, StaticStage, Stream
from rfca_rig.recording.store import open_sealed, report_damage, texts_of
from rfca_rig.recording.strokes import (
    RAW,
    STROKES,
    TIME,
    check_times,
    height_mm,
    read_condition,
    read_height_mm,
    read_streams,
    read_strokes_before,
    streams_in,
)
from rfca_rig.recording.tables import CYCLES, read_static

Rows = NDArray[Any]

Streams = Mapping[str, Stream]


class Sliceable(Protocol):
    """One-dimensional numbers (m,), in memory or in a file of which a slice is read."""

    @property
    def dtype(self) -> np.dtype[Any]: ...

    def __len__(self) -> int: ...

    def __getitem__(self, rows: slice, /) -> Rows: ...


@dataclass(frozen=True)
class StoredColumn:
    """A column (m,) of numbers in `unit`."""

    data: Sliceable
    unit: str

    @property
    def is_count(self) -> bool:
        """Whether it holds whole numbers, for instance a sequence number or a status word."""
        return self.data.dtype.kind in "iu"

    def values(self, rows: slice) -> Rows:
        """Values (k,) of these rows in the column's unit; a count stays a whole number."""
        data = self.data[rows]
        # A count as a float would lose digits and its meaning.
        if self.is_count:
            return data.astype(np.int64)
        return data.astype(np.float64)


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
    """Implements Sliceable for a dataset of this layout. Damage in what is read raises BadInput
    that names the file.
    """

    path: Path
    dataset: h5py.Dataset
    form: ColumnForm

    @property
    def dtype(self) -> np.dtype[Any]:
        return self.form.stored_dtype

    def __len__(self) -> int:
        return len(self.dataset)

    def __getitem__(self, rows: slice, /) -> Rows:
        """Values (k,) of these rows."""
        with report_damage(self.path):
            values = self.form.values(np.asarray(self.dataset[rows]))
            if self.form.name == TIME:
                check_times(self.dataset.parent, values)
            return values


def streams_in_file(path: Path, stage: h5py.Group, source: Source) -> tuple[StoredStream, ...]:
    """Streams of a stage's group, valid while the file at `path` is open. Raises BadInput where
    they are damaged.
    """
    streams = []
    with report_damage(path):
        for name, group in streams_in(stage, source):
            times = _dataset_in(path, group, TIME)
            columns = {}
            for column in read_names(group.attrs["order"]):
                dataset = _dataset_in(path, group, column)
                columns[column] = StoredColumn(dataset, dataset.form.unit)
            streams.append(StoredStream(name, times, columns))
    return tuple(streams)


def _dataset_in(path: Path, stream: h5py.Group, name: str) -> DatasetInFile:
    return DatasetInFile(path, stream[link_name(name)], read_form(stream, name))


def streams_in_memory(streams: Mapping[str, Stream]) -> tuple[StoredStream, ...]:
    """The same for streams in memory."""
    stored = []
    for name, stream in streams.items():
        columns = {}
        for key, column in stream.columns.items():
            columns[key] = StoredColumn(column.data, column.unit)
        stored.append(StoredStream(name, stream.t_s, columns))
    return tuple(stored)


class StoredSamples(Protocol):
    """Access to a stage's samples. `names` are those of its streams, `span_s` its first and last
    time, both 0 without samples.
    """

    @property
    def names(self) -> tuple[str, ...]: ...

    @property
    def span_s(self) -> tuple[float, float]: ...

    def whole(self) -> Streams:
        """All samples, in memory."""
        ...

    def open_streams(self) -> AbstractContextManager[tuple[StoredStream, ...]]:
        """The samples, to be read in blocks."""
        ...


@dataclass(frozen=True)
class SamplesInMemory:
    """Implements StoredSamples for a stage that was read already."""

    streams: Streams

    @property
    def names(self) -> tuple[str, ...]:
        return tuple(self.streams)

    @property
    def span_s(self) -> tuple[float, float]:
        return _span(
            [
                (float(stream.t_s.min()), float(stream.t_s.max()))
                for stream in self.streams.values()
                if len(stream.t_s)
            ]
        )

    def whole(self) -> Streams:
        return self.streams

    def open_streams(self) -> AbstractContextManager[tuple[StoredStream, ...]]:
        return nullcontext(streams_in_memory(self.streams))


@dataclass(frozen=True)
class SamplesInFile:
    """Implements StoredSamples for a group of a file, whose seal was verified when the file was
    first opened.
    """

    path: Path
    group: str
    names: tuple[str, ...]
    span_s: tuple[float, float]

    @classmethod
    def of(cls, path: Path, file: h5py.File, group: str) -> "SamplesInFile":
        """The samples of a group. Raises ValueError where one of its streams is not of the
        recording's source, or has no times.
        """
        streams = dict(streams_in(file[group], file.attrs["source"]))
        spans = []
        for stream in streams.values():
            if len(times := stream[TIME]):
                # Only the first and last time are read, not the samples between them.
                span = float(times[0]), float(times[-1])
                check_times(stream, np.array(span))
                spans.append(span)
        return cls(path, group, tuple(streams), _span(spans))

    def whole(self) -> Streams:
        with report_damage(self.path), h5py.File(self.path, "r") as file:
            return read_streams(file[self.group], file.attrs["source"])

    @contextmanager
    def open_streams(self) -> Iterator[tuple[StoredStream, ...]]:
        # Damage shows where a block is read. The caller's own errors, for instance of a full disk,
        # are not the recording's.
        with h5py.File(self.path, "r") as file:
            yield streams_in_file(self.path, file[self.group], file.attrs["source"])


def _span(spans: Sequence[tuple[float, float]]) -> tuple[float, float]:
    return min((first_s for first_s, _ in spans), default=0.0), max(
        (last_s for _, last_s in spans), default=0.0
    )


@dataclass(frozen=True)
class StoredStage:
    """A stroke, or the raw samples of another stage. `about` describes it for people;
    `speed_rad_s` and `strokes_before`, as in `Stroke`, apply to a stroke.
    """

    label: str
    about: Mapping[str, Any]
    height_m: float
    samples: StoredSamples = field(repr=False)
    speed_rad_s: float = 0.0
    cut_short: str = ""
    strokes_before: int | None = None

    @property
    def is_cycle_table(self) -> bool:
        """Whether its rows each summarise a cycle, and are no samples."""
        return CYCLES in self.samples.names


@dataclass(frozen=True)
class StoredRecording:
    """A recording whose samples are still in their files. The paths of its photos are relative
    to `folder`.
    """

    folder: Path
    title: str
    source: Source
    nominal: Mapping[str, Any]
    known_to: Mapping[str, float]
    provenance: Mapping[str, str]
    static: tuple[StaticStage, ...]
    strokes: tuple[StoredStage, ...]
    raw: tuple[StoredStage, ...]


def open_stored(path: Path) -> StoredRecording:
    """Open the recording at `path`: a run's folder, also of a running or interrupted run, a
    recording file, or a campaign.

    Raises BadInput for anything else, and for damaged files.
    """
    if path.is_dir():
        refuse_links(path)
        folder = path
        file = path / RECORDING_NAME
    else:
        folder = path.parent
        file = path
    # HDF5 files are opened in place; anything else is read into memory.
    if file.is_file() and file.suffix == ".h5":
        return _in_one_file(folder, file)
    if path.is_dir() and run_folder.is_run(path):
        return _in_stage_files(path)
    return store_in_memory(folder, open_recordings([path])[0])


def store_in_memory(folder: Path, recording: Recording) -> StoredRecording:
    """A recording that is read already."""
    strokes = tuple(
        _stroke(
            SamplesInMemory(stroke.streams),
            stroke.height_m,
            stroke.speed_rad_s,
            stroke.repeat,
            stroke.strokes_before,
        )
        for stroke in recording.strokes
    )
    raw = tuple(
        _raw(SamplesInMemory(stage.streams), stage.label, stage.height_m, stage.cut_short)
        for stage in recording.raw
    )
    return _make_stored(folder, recording, recording.static, strokes, raw)


def _in_one_file(folder: Path, path: Path) -> StoredRecording:
    with open_sealed(path) as (file, source):
        if not file.attrs.get(SEALED, False):
            return store_in_memory(folder, open_unsealed(path))
        return _make_stored(
            folder,
            texts_of(file, source),
            read_static(file),
            tuple(_strokes_in(file, path)),
            tuple(_raw_in(file, path)),
        )


def _in_stage_files(folder: Path) -> StoredRecording:
    """Of a run that was not put together yet."""
    known = run_folder.read_without_samples(folder)
    strokes: list[StoredStage] = []
    raw: list[StoredStage] = []
    for path in stage_files(folder):
        with open_sealed(path) as (file, _):
            strokes += _strokes_in(file, path)
            raw += _raw_in(file, path)
    return _make_stored(folder, known, known.static, tuple(strokes), tuple(raw))


def _make_stored(
    folder: Path,
    known: Recording,
    static: tuple[StaticStage, ...],
    strokes: tuple[StoredStage, ...],
    raw: tuple[StoredStage, ...],
) -> StoredRecording:
    return StoredRecording(
        folder,
        known.title,
        known.source,
        known.nominal,
        known.known_to,
        known.provenance,
        static,
        strokes,
        raw,
    )


def _strokes_in(file: h5py.File, path: Path) -> Iterator[StoredStage]:
    # Groups are numbered, and HDF5 lists them as text: 10 before 2.
    for name in sorted(file[STROKES], key=int):
        height, speed_rad_s, repeat = read_condition(file[STROKES][name])
        yield _stroke(
            SamplesInFile.of(path, file, f"{STROKES}/{name}"),
            height / 1e3,
            speed_rad_s,
            repeat,
            read_strokes_before(file[STROKES][name]),
        )


def _raw_in(file: h5py.File, path: Path) -> Iterator[StoredStage]:
    groups = file.get(RAW, {})
    for name in sorted(groups, key=int):
        about = groups[name].attrs
        height_m = read_height_mm(groups[name]) / 1e3
        yield _raw(
            SamplesInFile.of(path, file, f"{RAW}/{name}"),
            str(about["label"]),
            height_m,
            str(about["cut_short"]),
        )


def _stroke(
    samples: StoredSamples,
    height_m: float,
    speed_rad_s: float,
    repeat: int,
    strokes_before: int | None,
) -> StoredStage:
    about = {"height_mm": height_mm(height_m), "speed_rad_s": speed_rad_s, "repeat": repeat}
    return StoredStage(
        flap_label(height_m, speed_rad_s, repeat),
        about,
        height_m,
        samples,
        speed_rad_s,
        strokes_before=strokes_before,
    )


def _raw(samples: StoredSamples, label: str, height_m: float, cut_short: str) -> StoredStage:
    return StoredStage(
        label,
        {"height_mm": height_mm(height_m), "cut_short": cut_short},
        height_m,
        samples,
        cut_short=cut_short,
    )
