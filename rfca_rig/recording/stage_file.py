"""Makes a stage's file from its journal. A stage that ends in good order goes the same way as one
that a crash left.

The journal is read twice: once to learn how long the stage is and when it began, once to copy. A
stage of hours takes no more memory than one of seconds.
"""

import json
import struct
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from rfca_rig.errors import BadInput
from rfca_rig.recording.columns import (
    DEVICE_TIME,
    HOST_TIME,
    ROWS_PER_CHUNK,
    CommandedStart,
    RowBatches,
    Rows,
    apply_start,
    host_offset_s,
    link_name,
)
from rfca_rig.recording.hdf5_file import NewHdf5File, Steps, new_hdf5_file
from rfca_rig.recording.journal import Begin, BlockKind, End, read_blocks, start_of
from rfca_rig.recording.model import Recording
from rfca_rig.recording.store import mark_recording
from rfca_rig.recording.strokes import (
    TIME,
    make_raw_stages,
    make_streams,
    make_strokes,
    mark_raw_stage,
    mark_stroke,
    write_rows,
)
from rfca_rig.recording.tables import write_static

INTERRUPTED = "the recording was interrupted"


@dataclass(frozen=True)
class Survey:
    """Content of a journal.

    Per stream, in the order of `begin.forms`: `lengths` are numbers of samples, `host_offsets_s`
    what to add to the device's clock to get the host's.
    """

    begin: Begin
    start: CommandedStart
    end: End
    lengths: tuple[int, ...]
    host_offsets_s: tuple[float, ...]


@dataclass(frozen=True)
class StageOnDisk:
    """A stage on disk: samples by stream, SHA-256 of its file, and the block with which it
    ended.
    """

    samples: Mapping[str, int]
    sha256: str
    end: End

    def event(self, name: str, **about: str) -> bytes:
        """The stage's line for `events.jsonl`."""
        why = self.end.cut_short
        if why:
            outcome = {"event": "stage cut short", "why": why}
        else:
            outcome = {"event": "stage recorded"}
        event = {**outcome, "file": name, "sha256": self.sha256, "samples": self.samples, **about}
        return (json.dumps(event, ensure_ascii=False) + "\n").encode()


def write_stage(journal: Path, path: Path, header: Recording) -> Steps[StageOnDisk | None]:
    """Writes a journal, up to its last whole block, into a stage file; the result is None, without
    a file, where it holds no sample.

    The stage counts as recorded when the last step is done.

    Parameters
    ----------
    journal : Path
        The journal of one stage.
    path : Path
        Where the stage file goes.
    header : Recording
        Title and source of the run.

    Raises
    ------
    RigError, DiskFull
        The disk refused.
    BadInput
        Blocks are whole and yet make no sense.
    """
    with _sense_in(journal):
        survey = yield from _survey(journal)
    if survey is None or not (survey.end.stroke or any(survey.lengths)):
        return None
    with new_hdf5_file(path) as made:
        yield from _fill(made, survey, journal, header)
        sha256 = yield from made.put_in_place()
    samples = {
        form.name: length for form, length in zip(survey.begin.forms, survey.lengths, strict=True)
    }
    return StageOnDisk(samples, sha256, survey.end)


@contextmanager
def _sense_in(journal: Path) -> Iterator[None]:
    try:
        yield
    except (ValueError, LookupError, TypeError, OSError, RecursionError, struct.error) as error:
        raise BadInput(
            f"{journal}: is no journal of a stage: {type(error).__name__}: {error}"
        ) from None


def _survey(journal: Path) -> Steps[Survey | None]:
    blocks = read_blocks(journal)
    first = next(blocks, None)
    # A journal whose first block never reached the disk whole names no stage and no columns.
    if first is None or first.kind is not BlockKind.BEGIN:
        return None
    begin = Begin.of(first)
    bounds = _Found()
    counts = [_Count() for _ in begin.forms]
    for stream, rows in bounds.batches(begin, journal):
        counts[stream].add(rows)
        yield
    # Without a commanded start the stage was cut short before it; times then count from the first
    # sample.
    first_s = min((count.first_s for count in counts if count.length), default=0.0)
    lengths = tuple(count.length for count in counts)
    offsets_s = tuple(count.offset_s for count in counts)
    return Survey(begin, bounds.start or CommandedStart(first_s), bounds.end, lengths, offsets_s)


class _Found:
    """Commanded start and end of a stage, as its blocks say."""

    def __init__(self) -> None:
        self.start: CommandedStart | None = None
        # What holds unless an END block follows: a crash writes none.
        self.end = End(cut_short=INTERRUPTED)

    def batches(self, begin: Begin, journal: Path) -> Iterator[tuple[int, Rows]]:
        """The samples of a journal, in batches of ROWS_PER_CHUNK, each with the number of its
        stream.
        """
        gathering = RowBatches(begin.forms, ROWS_PER_CHUNK)
        for block in read_blocks(journal):
            match block.kind:
                case BlockKind.SAMPLES:
                    yield from gathering.add(block.payload)
                case BlockKind.START:
                    self.start = start_of(block)
                case BlockKind.END:
                    self.end = End.of(block)
        yield from gathering.rest()


class _Count:
    """Length, first host time and clock offset of one stream."""

    def __init__(self) -> None:
        self.length = 0
        self.first_s = 0.0
        self.offset_s = np.inf

    def add(self, rows: Rows) -> None:
        if len(rows):
            if not self.length:
                self.first_s = float(rows[HOST_TIME][0])
            self.length += len(rows)
            # The least delay of all samples is nearest to none; see `columns.host_offset_s`.
            self.offset_s = min(self.offset_s, host_offset_s(rows[HOST_TIME], rows[DEVICE_TIME]))


def _fill(made: NewHdf5File, survey: Survey, journal: Path, header: Recording) -> Steps[None]:
    begin = survey.begin
    end = survey.end
    source = header.source
    mark_recording(made.root, stage_header(header), has_strokes=bool(end.stroke))
    strokes = make_strokes(made.root)
    write_static(made.root, (end.static,) if end.static and not end.stroke else ())
    if end.stroke:
        group = strokes.create_group("001")
        mark_stroke(group, begin.height_m, end.stroke.speed_rad_s, end.stroke.repeat)
    else:
        group = make_raw_stages(made.root).create_group("001")
        mark_raw_stage(group, begin.label, begin.height_m, end.cut_short)
    forms = [apply_start(form, survey.start) for form in begin.forms]
    make_streams(group, list(zip(forms, survey.lengths, strict=True)), source)
    filled = [0] * len(forms)
    for stream, rows in _Found().batches(begin, journal):
        target = group[link_name(forms[stream].name)]
        for column in forms[stream].columns:
            values = column.values(rows[column.name])
            write_rows(target, column.name, filled[stream], values)
        # One offset for the whole stage: times keep the device's even spacing, free of the jitter
        # of arrival.
        write_rows(
            target,
            TIME,
            filled[stream],
            rows[DEVICE_TIME] + (survey.host_offsets_s[stream] - survey.start.start_s),
        )
        filled[stream] += len(rows)
        # After each batch: writes that the disk refused stay in memory, which must not grow.
        made.check()
        yield


def stage_header(header: Recording) -> Recording:
    """The part of the run's header that every stage file repeats."""
    return replace(header, nominal={}, known_to={}, strokes=(), static=(), provenance={})
