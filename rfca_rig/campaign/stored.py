"""Opens a recording stage by stage, so that hours of it need only the memory of the part in use."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import h5py

from rfca_rig.campaign.opening import RECORDING_NAME, open_recordings
from rfca_rig.campaign.stored_samples import SamplesInFile, SamplesInMemory, StoredSamples
from rfca_rig.protocol.plan import flap_label
from rfca_rig.recording import run_folder
from rfca_rig.recording.cycle_table import CYCLES
from rfca_rig.recording.layout import refuse_links, stage_files
from rfca_rig.recording.model import Recording, Source, StaticStage
from rfca_rig.recording.static_table import read_static
from rfca_rig.recording.store import open_sealed, texts_of
from rfca_rig.recording.strokes import RAW, STROKES, height_mm, read_condition, read_height_mm


@dataclass(frozen=True)
class StoredStage:
    """A stroke, or the raw samples of another stage. `about` describes it for people; `speed_rad_s` applies to a stroke."""

    label: str
    about: Mapping[str, Any]
    height_m: float
    samples: StoredSamples = field(repr=False)
    speed_rad_s: float = 0.0
    cut_short: str = ""

    @property
    def is_cycle_table(self) -> bool:
        """Whether its rows each summarise a cycle, and are no samples."""
        return CYCLES in self.samples.names


@dataclass(frozen=True)
class StoredRecording:
    """A recording whose samples are still in their files. The paths of its photos are relative to `folder`."""

    folder: Path
    title: str
    source: Source
    nominal: Mapping[str, Any]
    provenance: Mapping[str, str]
    static: tuple[StaticStage, ...]
    strokes: tuple[StoredStage, ...]
    raw: tuple[StoredStage, ...]


def open_stored(path: Path) -> StoredRecording:
    """Open the recording at `path`: a run's folder, also of a running or interrupted run, a recording file, or a campaign.

    Raises BadInput for anything else, and for damaged files.
    """
    if path.is_dir():
        refuse_links(path)
    file = path / RECORDING_NAME if path.is_dir() else path
    folder = path if path.is_dir() else path.parent
    # HDF5 files are opened in place; anything else is read into memory.
    if file.is_file() and file.suffix == ".h5":
        return _in_one_file(folder, file)
    if path.is_dir() and run_folder.is_run(path):
        return _in_stage_files(path)
    return store_in_memory(folder, open_recordings([path])[0])


def store_in_memory(folder: Path, recording: Recording) -> StoredRecording:
    """A recording that is read already."""
    strokes = tuple(_stroke(SamplesInMemory(one.streams), one.height_m, one.speed_rad_s, one.repeat) for one in recording.strokes)
    raw = tuple(_raw(SamplesInMemory(one.streams), one.label, one.height_m, one.cut_short) for one in recording.raw)
    return _make_stored(folder, recording, recording.static, strokes, raw)


def _in_one_file(folder: Path, path: Path) -> StoredRecording:
    with open_sealed(path) as (file, source):
        return _make_stored(folder, texts_of(file, source), read_static(file), tuple(_strokes_in(file, path)), tuple(_raw_in(file, path)))


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
    folder: Path, known: Recording, static: tuple[StaticStage, ...], strokes: tuple[StoredStage, ...], raw: tuple[StoredStage, ...]
) -> StoredRecording:
    return StoredRecording(folder, known.title, known.source, known.nominal, known.provenance, static, strokes, raw)


def _strokes_in(file: h5py.File, path: Path) -> Iterator[StoredStage]:
    # Groups are numbered, and HDF5 lists them as text: 10 before 2.
    for name in sorted(file[STROKES], key=int):
        height, speed_rad_s, repeat = read_condition(file[STROKES][name])
        yield _stroke(SamplesInFile.of(path, file, f"{STROKES}/{name}"), height / 1e3, speed_rad_s, repeat)


def _raw_in(file: h5py.File, path: Path) -> Iterator[StoredStage]:
    groups = file.get(RAW, {})
    for name in sorted(groups, key=int):
        about = groups[name].attrs
        height_m = read_height_mm(groups[name]) / 1e3
        yield _raw(SamplesInFile.of(path, file, f"{RAW}/{name}"), str(about["label"]), height_m, str(about["cut_short"]))


def _stroke(samples: StoredSamples, height_m: float, speed_rad_s: float, repeat: int) -> StoredStage:
    about = {"height_mm": height_mm(height_m), "speed_rad_s": speed_rad_s, "repeat": repeat}
    return StoredStage(flap_label(height_m, speed_rad_s, repeat), about, height_m, samples, speed_rad_s)


def _raw(samples: StoredSamples, label: str, height_m: float, cut_short: str) -> StoredStage:
    return StoredStage(label, {"height_mm": height_mm(height_m), "cut_short": cut_short}, height_m, samples, cut_short=cut_short)
