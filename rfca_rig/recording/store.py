"""A recording as one HDF5 file, `rfca-recording/2`. Files of the first format hold counts, which
become values when they are read.

    /            attributes format, title, source, sealed
    /believed    JSON text: leg, ground, sensor, drive of the nominal model
    /known_to    JSON text: one standard deviation of each nominal value
    /provenance  JSON text: text by name
    /strokes/001 attributes height_mm, speed_rad_s, repeat; a group per stream, see `strokes`
    /static      a column per quantity, a row per stage, see `static_table`
    /raw/001     samples of stages that are no strokes, see `strokes`

Behind the end stands a seal, see `hdf5_file`. `summarize` and `outline_of` say what a file holds
without holding it in memory.
"""

import json
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import h5py

from rfca_rig.errors import BadInput
from rfca_rig.recording import strokes
from rfca_rig.recording.columns import (
    FORMAT,
    FORMAT_OF_COUNTS,
    ROWS_PER_CHUNK,
    link_name,
    read_form,
    read_names,
)
from rfca_rig.recording.hdf5_file import (
    SEALED,
    new_hdf5_file,
    open_plain,
    read_seal,
    run_to_completion,
)
from rfca_rig.recording.model import Recording, Source, StaticStage, check_source, check_texts
from rfca_rig.recording.strokes import (
    RAW,
    STROKES,
    TIME,
    check_times,
    read_condition,
    read_raw_stages,
    read_strokes,
    streams_in,
    write_raw_stages,
    write_strokes,
)
from rfca_rig.recording.tables import CYCLES, NUMBER, read_static, write_static

MOST_TITLE = 1000


def write_recording(recording: Recording, path: Path) -> Path:
    """Writes the recording to `path`, complete or not at all; the same recording always gives the
    same bytes. Returns `path`.

    Raises RigError when the disk refuses, ValueError for columns that are not equally long rows of
    numbers.
    """
    with new_hdf5_file(path) as made:
        mark_recording(
            made.root, recording, has_strokes=bool(recording.strokes or not recording.raw)
        )
        write_strokes(made.root, recording.strokes, recording.source)
        write_static(made.root, recording.static)
        write_raw_stages(made.root, recording.raw, recording.source)
        run_to_completion(made.put_in_place())
    return path


def mark_recording(file: h5py.Group, recording: Recording, has_strokes: bool) -> None:
    """Writes everything except strokes and stages."""
    file.attrs["format"] = FORMAT
    file.attrs["title"] = recording.title
    file.attrs["source"] = recording.source
    strokes.mark_root(file, STROKES if has_strokes else RAW)
    # Datasets, because HDF5 attributes end at 64 kB and a plan may be longer.
    for name, content in (
        ("believed", recording.nominal),
        ("known_to", recording.known_to),
        ("provenance", recording.provenance),
    ):
        text = json.dumps(dict(content), ensure_ascii=False).encode()
        # Without track_times the file holds no date of its making, so that equal recordings give
        # equal bytes.
        file.create_dataset(
            name, data=text, dtype=h5py.string_dtype("utf-8", len(text)), track_times=False
        )


def read_recording(path: Path) -> Recording:
    """The recording in `path`, all of it in memory. Raises BadInput for a file that is damaged
    or of another kind.
    """
    with open_sealed(path) as (file, source):
        return Recording(
            title=read_title(file),
            source=source,
            nominal=read_text(file, "believed"),
            known_to=read_text(file, "known_to"),
            strokes=read_strokes(file, source),
            static=read_static(file),
            provenance=read_provenance(file),
            raw=read_raw_stages(file, source),
        )


def read_texts(path: Path, has_right_seal: bool = False) -> Recording:
    """The recording without its samples and stages. Raises BadInput as `read_recording` does."""
    with open_sealed(path, has_right_seal) as (file, source):
        return texts_of(file, source)


def texts_of(file: h5py.File, source: Source) -> Recording:
    """The same of an open file."""
    return Recording(
        read_title(file),
        source,
        read_text(file, "believed"),
        read_text(file, "known_to"),
        (),
        (),
        read_provenance(file),
    )


@contextmanager
def open_sealed(path: Path, has_right_seal: bool = False) -> Iterator[tuple[h5py.File, Source]]:
    """Yields the open file and its source, after its seal was checked, unless it is known to be
    right.

    Raises BadInput for a damaged file or another format.
    """
    with report_damage(path):
        # Before HDF5 opens it: a damaged index can make the library search for ever.
        is_right = has_right_seal or read_seal(path)
        if is_right is False:
            raise ValueError(
                "its checksum does not match, so bytes were changed after it was written"
            )
        with open_plain(path) as file:
            if is_right is None and file.attrs.get(SEALED, False):
                raise ValueError(
                    "its checksum is gone from its end, so it was changed after it was written"
                )
            file_format = file.attrs.get("format")
            if not isinstance(file_format, str) or file_format not in (FORMAT, FORMAT_OF_COUNTS):
                if isinstance(file_format, str):
                    description = f"format {str(file_format)[:60]!r}"
                else:
                    description = "an HDF5 file without format attribute"
                raise BadInput(
                    f"{path}: {description}, where a recording of format {FORMAT!r} is needed"
                )
            yield file, check_source(file.attrs["source"])


@contextmanager
def report_damage(path: Path) -> Iterator[None]:
    """Turns any error of HDF5 or of the layout into one message: this file is not a whole
    recording.
    """
    if not path.is_file():
        raise BadInput(f"{path}: is not there")
    try:
        yield
    # h5py raises nearly any of these for damaged bytes, depending on where they are.
    except (
        OSError,
        RuntimeError,
        LookupError,
        ValueError,
        TypeError,
        AttributeError,
        MemoryError,
        ArithmeticError,
    ) as error:
        message = " ".join(str(error).split()) or type(error).__name__
        raise BadInput(
            f"{path}: is not a whole recording of format {FORMAT!r}: {message[:240]}"
        ) from error


def read_text(file: h5py.File, name: str) -> dict[str, Any]:
    """A table of values by name. Raises ValueError for anything else."""
    content = json.loads(file[name][()])
    if not isinstance(content, dict):
        raise ValueError(f"{name} is not a table of values by name")
    return content


def read_provenance(file: h5py.File) -> dict[str, str]:
    """Text by name. Raises ValueError for anything else."""
    return check_texts(read_text(file, "provenance"))


def read_title(file: h5py.File) -> str:
    """Raises ValueError where it is no text, or longer than a page."""
    title = file.attrs["title"]
    if not isinstance(title, str) or len(title) > MOST_TITLE:
        raise ValueError(f"its title is no text of {MOST_TITLE} letters at most")
    return title


SEQUENCE = "rdt_sequence"


@dataclass(frozen=True)
class RecordingSummary:
    """Counts of a recording. `samples` are by name of the stream.

    `missing` has, for each stream with gaps, the number of records that the sensor's own numbering
    leaves out. `cut_short` are the labels of stages that were.
    """

    strokes: int
    static: int
    raw: int
    samples: Mapping[str, int]
    missing: tuple[int, ...]
    cut_short: tuple[str, ...]

    def text(self) -> str:
        return (
            f"{self.strokes} strokes, {self.static} static stages, {self.raw} raw, "
            f"{sum(self.samples.values())} samples"
        )


def summarize(path: Path, thorough: bool = True, has_right_seal: bool = False) -> RecordingSummary:
    """Counts what the file holds. `thorough` reads every value once, a piece at a time; otherwise
    the file's seal is trusted.

    `has_right_seal` where it was compared already.

    Raises BadInput for a file that is damaged or of another kind.
    """
    with open_sealed(path, has_right_seal) as (file, source):
        strokes = _in_order(file[STROKES])
        raw = []
        if RAW in file:
            raw = _in_order(file[RAW])
        for stroke in strokes:
            read_condition(stroke)
        samples: Counter[str] = Counter()
        missing = []
        for name, group in (
            stream for stage in (*strokes, *raw) for stream in streams_in(stage, source)
        ):
            samples[name] += len(group[TIME])
            # Only reading every chunk finds all damage: HDF5 decodes a chunk no earlier.
            if thorough:
                _read_through(group)
            missing += [gone for gone in _missing(group) if gone]
        cut_short = tuple(str(group.attrs["label"]) for group in raw if group.attrs["cut_short"])
        return RecordingSummary(
            len(strokes), len(read_static(file)), len(raw), dict(samples), tuple(missing), cut_short
        )


def add_up(tallies: Iterable[RecordingSummary]) -> RecordingSummary:
    """The sum of several recordings of one run."""
    parts = list(tallies)
    samples: Counter[str] = Counter()
    for part in parts:
        samples.update(part.samples)
    return RecordingSummary(
        sum(part.strokes for part in parts),
        sum(part.static for part in parts),
        sum(part.raw for part in parts),
        dict(samples),
        tuple(gone for part in parts for gone in part.missing),
        tuple(label for part in parts for label in part.cut_short),
    )


def _in_order(group: h5py.Group) -> list[h5py.Group]:
    return [group[number] for number in sorted(group, key=int)]


def _read_through(stream: h5py.Group) -> None:
    for name in (TIME, *read_names(stream.attrs["order"])):
        column = stream[link_name(name)]
        read_form(stream, name)
        for at in range(0, len(column), ROWS_PER_CHUNK):
            values = column[at : at + ROWS_PER_CHUNK]
            if name == TIME:
                check_times(stream, values)


def _missing(stream: h5py.Group) -> Iterator[int]:
    """Number of records missing between the first sample and the last, by the device's own
    numbering.
    """
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
    """Reads the outline of a file. Raises BadInput for a file that is damaged or of another
    kind.
    """
    with open_sealed(path) as (file, source):
        tables = [stage[CYCLES][NUMBER] for stage in file.get(RAW, {}).values() if CYCLES in stage]
        return RunOutline(
            title=read_title(file),
            source=source,
            provenance=read_provenance(file),
            strokes=tuple(
                read_condition(file[STROKES][number]) for number in sorted(file[STROKES], key=int)
            ),
            static=read_static(file),
            cycles=sum(len(table) for table in tables),
            last_cycle=max((int(table[-1]) for table in tables if len(table)), default=0),
        )
