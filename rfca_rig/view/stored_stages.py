"""The stages of a recording one by one, so that hours of it need no more memory than the part that is looked at."""

import json
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

import h5py

from rfca_rig.campaign.opening import RECORDING_NAME, open_recordings
from rfca_rig.recording import run_folder
from rfca_rig.recording.cycle_table import CYCLES
from rfca_rig.recording.form import Recording, StaticStage, Stream
from rfca_rig.recording.layout import stage_files
from rfca_rig.recording.raw_stages import GROUP as RAW
from rfca_rig.recording.static_table import read_static
from rfca_rig.recording.store import opened
from rfca_rig.recording.strokes import GROUP as STROKES
from rfca_rig.recording.strokes import TIME, read_streams, streams_in

Streams = Mapping[str, Stream]


@dataclass(frozen=True)
class StoredStage:
    """A stroke, or what is behind a static stage. Its first and last sample, in the stage's own time; both 0 where it has none."""

    height_m: float
    first_s: float
    last_s: float
    streams: Callable[[], Streams] = field(repr=False)
    speed_rad_s: float = 0.0
    repeat: int = 0
    label: str = ""
    cut_short: str = ""


@dataclass(frozen=True)
class Stored:
    """A recording whose samples are still where they were."""

    title: str
    source: str
    believed: Mapping[str, Any]
    provenance: Mapping[str, str]
    static: tuple[StaticStage, ...]
    strokes: tuple[StoredStage, ...]
    raw: tuple[StoredStage, ...]


def stored_at(path: Path) -> Stored:
    """What a user may point at: a run's folder, also of one that goes on or was cut short, a recording file, or a campaign.

    Raises BadInput for anything else, and for damaged files.
    """
    file = path / RECORDING_NAME if path.is_dir() else path
    if file.is_file() and file.suffix == ".h5":
        return _in_one_file(file)
    if path.is_dir() and run_folder.is_run(path):
        return _in_stage_files(path)
    return in_memory(open_recordings([path])[0])


def in_memory(recording: Recording) -> Stored:
    """A recording that is read already."""
    strokes = tuple(_stage(one.streams, height_m=one.height_m, speed_rad_s=one.speed_rad_s, repeat=one.repeat) for one in recording.strokes)
    raw = tuple(
        _stage(one.streams, height_m=one.height_m, label=one.label, cut_short=one.cut_short)
        for one in recording.raw
        if CYCLES not in one.streams
    )
    return Stored(recording.title, recording.source, recording.believed, recording.provenance, recording.static, strokes, raw)


def _stage(streams: Streams, **about: Any) -> StoredStage:
    first_s, last_s = _span([(float(stream.t_s.min()), float(stream.t_s.max())) for stream in streams.values() if len(stream.t_s)])
    return StoredStage(first_s=first_s, last_s=last_s, streams=lambda: streams, **about)


def _span(spans: Sequence[tuple[float, float]]) -> tuple[float, float]:
    return min((first_s for first_s, _ in spans), default=0.0), max((last_s for _, last_s in spans), default=0.0)


def _in_one_file(path: Path) -> Stored:
    with opened(path) as (file, source):
        texts = {name: json.loads(file[name][()]) for name in ("believed", "provenance")}
        strokes, raw = tuple(_strokes_in(file, path)), tuple(_raw_in(file, path))
        return Stored(str(file.attrs["title"]), source, texts["believed"], texts["provenance"], read_static(file), strokes, raw)


def _in_stage_files(folder: Path) -> Stored:
    """Of a run that was not put together yet."""
    known = run_folder.read_without_samples(folder)
    strokes: list[StoredStage] = []
    raw: list[StoredStage] = []
    for path in stage_files(folder):
        with opened(path) as (file, _):
            strokes += _strokes_in(file, path)
            raw += _raw_in(file, path)
    return Stored(known.title, known.source, known.believed, known.provenance, known.static, tuple(strokes), tuple(raw))


def _strokes_in(file: h5py.File, path: Path) -> Iterator[StoredStage]:
    for name in sorted(file[STROKES], key=int):
        group = file[STROKES][name]
        first_s, last_s = _span_in(group, file)
        about = group.attrs
        height_m, condition = float(about["height_mm"]) / 1e3, (float(about["speed_rad_s"]), int(about["repeat"]))
        yield StoredStage(height_m, first_s, last_s, partial(_read, path, f"{STROKES}/{name}"), *condition)


def _raw_in(file: h5py.File, path: Path) -> Iterator[StoredStage]:
    """But for the table of cycles, which has no samples."""
    groups = file.get(RAW, {})
    for name in sorted(groups, key=int):
        group = groups[name]
        if CYCLES in json.loads(group.attrs["order"]):
            continue
        first_s, last_s = _span_in(group, file)
        yield StoredStage(
            float(group.attrs["height_mm"]) / 1e3,
            first_s,
            last_s,
            partial(_read, path, f"{RAW}/{name}"),
            label=str(group.attrs["label"]),
            cut_short=str(group.attrs["cut_short"]),
        )


def _span_in(group: h5py.Group, file: h5py.File) -> tuple[float, float]:
    times = [stream[TIME] for _, stream in streams_in(group, file.attrs["source"])]
    return _span([(float(time[0]), float(time[-1])) for time in times if len(time)])


def _read(path: Path, group: str) -> Streams:
    """The seal was found whole when the file was opened first."""
    with h5py.File(path, "r") as file:
        return read_streams(file[group], file.attrs["source"])
