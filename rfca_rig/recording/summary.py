"""What a recording on disk holds, without holding it in memory: counts of its stages and samples, and its summary without samples."""

from collections import Counter
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

import h5py

from rfca_rig.recording.columns import ROWS_PER_CHUNK, link_name, read_names, read_scale
from rfca_rig.recording.model import StaticStage
from rfca_rig.recording.store import open_sealed, read_provenance, read_title
from rfca_rig.recording.strokes import RAW, STROKES, TIME, check_times, read_condition, streams_in
from rfca_rig.recording.tables import CYCLES, NUMBER, read_static

SEQUENCE = "rdt_sequence"


@dataclass(frozen=True)
class RecordingSummary:
    """Counts of a recording. `samples` are by name of the stream.

    `missing` has, for each stream with gaps, the number of records that the sensor's own numbering leaves out. `cut_short` are the labels
    of stages that were.
    """

    strokes: int
    static: int
    raw: int
    samples: Mapping[str, int]
    missing: tuple[int, ...]
    cut_short: tuple[str, ...]

    def text(self) -> str:
        return f"{self.strokes} strokes, {self.static} static stages, {self.raw} raw, {sum(self.samples.values())} samples"


def summarize(path: Path, thorough: bool = True, has_right_seal: bool = False) -> RecordingSummary:
    """Counts what the file holds. `thorough` reads every value once, a piece at a time; otherwise the file's seal is trusted.

    `has_right_seal` where it was compared already.

    Raises BadInput for a file that is damaged or of another kind.
    """
    with open_sealed(path, has_right_seal) as (file, source):
        strokes, raw = _in_order(file[STROKES]), _in_order(file[RAW]) if RAW in file else []
        for stroke in strokes:
            read_condition(stroke)
        samples: Counter[str] = Counter()
        missing = []
        for name, group in (each for stage in (*strokes, *raw) for each in streams_in(stage, source)):
            samples[name] += len(group[TIME])
            # Only reading every chunk finds all damage: HDF5 decodes a chunk no earlier.
            if thorough:
                _read_through(group)
            missing += [gone for gone in _missing(group) if gone]
        cut_short = tuple(str(group.attrs["label"]) for group in raw if group.attrs["cut_short"])
        return RecordingSummary(len(strokes), len(read_static(file)), len(raw), dict(samples), tuple(missing), cut_short)


def add_up(tallies: Iterable[RecordingSummary]) -> RecordingSummary:
    """The sum of several recordings of one run."""
    parts = list(tallies)
    samples: Counter[str] = Counter()
    for part in parts:
        samples.update(part.samples)
    strokes, static, raw = (sum(getattr(part, name) for part in parts) for name in ("strokes", "static", "raw"))
    missing = tuple(gone for part in parts for gone in part.missing)
    return RecordingSummary(strokes, static, raw, dict(samples), missing, tuple(label for part in parts for label in part.cut_short))


def _in_order(group: h5py.Group) -> list[h5py.Group]:
    return [group[number] for number in sorted(group, key=int)]


def _read_through(stream: h5py.Group) -> None:
    for name in (TIME, *read_names(stream.attrs["order"])):
        column = stream[link_name(name)]
        read_scale(column)
        for at in range(0, len(column), ROWS_PER_CHUNK):
            values = column[at : at + ROWS_PER_CHUNK]
            if name == TIME:
                check_times(stream, values)


def _missing(stream: h5py.Group) -> Iterator[int]:
    """Number of records missing between the first sample and the last, by the device's own numbering."""
    if link_name(SEQUENCE) in stream and len(stream[SEQUENCE]):
        numbers = stream[SEQUENCE]
        yield int(numbers[-1]) - int(numbers[0]) + 1 - len(numbers)


@dataclass(frozen=True)
class RunOutline:
    """`strokes` has (height in mm, speed in rad/s, repeat) of each stroke.

    `last_cycle` is the number of the last cycle in the file, 0 without cycles.
    """

    title: str
    source: str
    provenance: Mapping[str, str]
    strokes: tuple[tuple[float, float, int], ...]
    static: tuple[StaticStage, ...]
    cycles: int
    last_cycle: int


def outline_of(path: Path) -> RunOutline:
    """Reads the outline of a file. Raises BadInput for a file that is damaged or of another kind."""
    with open_sealed(path) as (file, source):
        tables = [stage[CYCLES][NUMBER] for stage in file.get(RAW, {}).values() if CYCLES in stage]
        return RunOutline(
            title=read_title(file),
            source=source,
            provenance=read_provenance(file),
            strokes=tuple(read_condition(file[STROKES][number]) for number in sorted(file[STROKES], key=int)),
            static=read_static(file),
            cycles=sum(len(table) for table in tables),
            last_cycle=max((int(table[-1]) for table in tables if len(table)), default=0),
        )
