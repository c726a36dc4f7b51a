"""The stages of a recording with their samples still where they are, to be taken some thousand at a time."""

import json
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

import h5py
import numpy as np
from numpy.typing import NDArray

from rfca_rig.campaign.opening import RECORDING_NAME, open_recordings
from rfca_rig.recording.columns import ROWS_PER_CHUNK, link
from rfca_rig.recording.form import Recording, Source, StaticStage, Stream
from rfca_rig.recording.raw_stages import GROUP as RAW
from rfca_rig.recording.static_table import read_static
from rfca_rig.recording.store import opened
from rfca_rig.recording.strokes import GROUP as STROKES
from rfca_rig.recording.strokes import TIME, streams_in

Rows = NDArray[Any]


class Sliceable(Protocol):
    """A row of numbers in memory, or in a file of which a slice is read."""

    @property
    def dtype(self) -> np.dtype[Any]: ...

    def __len__(self) -> int: ...

    def __getitem__(self, rows: slice, /) -> Rows: ...


@dataclass(frozen=True)
class StoredColumn:
    """Its value in `unit` is raw * conversion + offset."""

    raw: Sliceable
    unit: str
    conversion: float
    offset: float

    @property
    def is_count(self) -> bool:
        """A whole number that stands for itself, such as a sequence or a status word."""
        return self.raw.dtype.kind in "iu" and self.conversion == 1.0 and self.offset == 0.0

    def values(self, rows: slice) -> Rows:
        """In its unit; a count stays a whole number."""
        raw = self.raw[rows]
        return raw.astype(np.int64) if self.is_count else raw.astype(np.float64) * self.conversion + self.offset


@dataclass(frozen=True)
class StoredStream:
    """Columns that share a time base, which counts from the stage's commanded start."""

    name: str
    t_s: Sliceable
    columns: Mapping[str, StoredColumn]

    def blocks(self) -> Iterator[slice]:
        """All rows, some at a time."""
        for at in range(0, len(self.t_s), ROWS_PER_CHUNK):
            yield slice(at, at + ROWS_PER_CHUNK)


@dataclass(frozen=True)
class StoredStage:
    """A stroke, or the samples of another stage. `about` says what it was, for people."""

    label: str
    about: Mapping[str, Any]
    streams: tuple[StoredStream, ...]


@dataclass(frozen=True)
class Stored:
    """A recording whose samples are read when they are asked for. `folder` is where its photos' paths begin."""

    folder: Path
    title: str
    source: Source
    believed: Mapping[str, Any]
    provenance: Mapping[str, str]
    static: tuple[StaticStage, ...]
    strokes: tuple[StoredStage, ...]
    raw: tuple[StoredStage, ...]


@contextmanager
def stored_at(path: Path) -> Iterator[Stored]:
    """What a user may point at; of a finished run nothing is read yet but the checksum. Raises BadInput as `open_recordings` does."""
    file = path / RECORDING_NAME if path.is_dir() else path
    folder = path if path.is_dir() else path.parent
    if file.is_file() and file.suffix == ".h5":
        with opened(file) as (content, source):
            yield _in_file(folder, content, source)
    else:
        yield _in_memory(folder, open_recordings([path])[0])


def _in_file(folder: Path, file: h5py.File, source: Source) -> Stored:
    strokes, raw = file.get(STROKES, {}), file.get(RAW, {})
    return Stored(
        folder=folder,
        title=str(file.attrs["title"]),
        source=source,
        believed=json.loads(file["believed"][()]),
        provenance=json.loads(file["provenance"][()]),
        static=read_static(file),
        strokes=tuple(_stroke_in(strokes[number], source) for number in sorted(strokes, key=int)),
        raw=tuple(_raw_in(raw[number], source) for number in sorted(raw, key=int)),
    )


def _stroke_in(group: h5py.Group, source: Source) -> StoredStage:
    about = {name: group.attrs[name].item() for name in ("height_mm", "speed_rad_s", "repeat")}
    return StoredStage(stroke_label(about), about, _streams_in(group, source))


def _raw_in(group: h5py.Group, source: Source) -> StoredStage:
    about = {"height_mm": float(group.attrs["height_mm"]), "cut_short": str(group.attrs["cut_short"])}
    return StoredStage(str(group.attrs["label"]), about, _streams_in(group, source))


def _streams_in(stage: h5py.Group, source: Source) -> tuple[StoredStream, ...]:
    return tuple(
        StoredStream(name, group[TIME], {column: _column_in(group[link(column)]) for column in json.loads(group.attrs["order"])})
        for name, group in streams_in(stage, source)
    )


def _column_in(dataset: h5py.Dataset) -> StoredColumn:
    attributes = dataset.attrs
    return StoredColumn(dataset, str(attributes["units"]), float(attributes["conversion"]), float(attributes["offset"]))


def _in_memory(folder: Path, recording: Recording) -> Stored:
    strokes = []
    for stroke in recording.strokes:
        about = {"height_mm": round(1e3 * stroke.height_m, 6), "speed_rad_s": stroke.speed_rad_s, "repeat": stroke.repeat}
        strokes.append(StoredStage(stroke_label(about), about, _streams_of(stroke.streams)))
    raw = [
        StoredStage(stage.label, {"height_mm": round(1e3 * stage.height_m, 6), "cut_short": stage.cut_short}, _streams_of(stage.streams))
        for stage in recording.raw
    ]
    known = recording
    return Stored(folder, known.title, known.source, known.believed, known.provenance, known.static, tuple(strokes), tuple(raw))


def _streams_of(streams: Mapping[str, Stream]) -> tuple[StoredStream, ...]:
    return tuple(
        StoredStream(
            name, stream.t_s, {key: StoredColumn(one.raw, one.unit, one.conversion, one.offset) for key, one in stream.columns.items()}
        )
        for name, stream in streams.items()
    )


def stroke_label(about: Mapping[str, Any]) -> str:
    """As the plan calls it."""
    return f"flap {about['height_mm']:.0f} mm, {about['speed_rad_s']:g} rad/s, repeat {about['repeat']}"


def static_row(held: StaticStage) -> dict[str, Any]:
    """The means of a static stage by the names that campaign files have for them."""
    hinges = {f"hinge{i}_deg": angle for i, angle in enumerate(held.hinge_deg, start=2)}
    about = {"height_mm": round(1e3 * held.height_m, 6), "stage": held.stage, "direction": held.direction}
    return {**about, "shaft_angle_rad": held.shaft_angle_rad, **hinges, **{name: getattr(held, name) for name in ("fy_N", "fz_N", "tx_Nm")}}
