"""A run's folder: created, read, assembled into `run.h5`, and recovered after a crash."""

import json
import shutil
from collections.abc import Iterable, Mapping
from dataclasses import replace
from pathlib import Path

import h5py

from rfca_rig.errors import BadInput
from rfca_rig.progress import ProgressCount, ignore_progress, iterate_with_progress
from rfca_rig.recording.atomic import AppendOnlyFile, remove, sync_folder, translate_os_errors
from rfca_rig.recording.hdf5_file import NewHdf5File, Steps, new_hdf5_file, run_to_completion
from rfca_rig.recording.layout import (
    ENDING,
    EVENTS,
    HEADER,
    RECORDING,
    STAGE,
    STAGES,
    SUMS,
    WRITING,
    journals,
    stage_files,
    write_sums,
)
from rfca_rig.recording.model import Recording, Source, StaticStage
from rfca_rig.recording.run_text import (
    INTERRUPTED,
    Ending,
    check_not_running,
    complete_lines_length,
    ending_bytes,
    events_of,
    lock,
    read_ending,
    read_header,
    run_provenance,
    write_ending,
    write_header,
)
from rfca_rig.recording.run_writer import DiskReserve
from rfca_rig.recording.stage_file import write_stage
from rfca_rig.recording.store import mark_recording, open_sealed, read_recording, write_recording
from rfca_rig.recording.strokes import RAW, STROKES, copy_streams, make_raw_stages, make_strokes
from rfca_rig.recording.tables import read_static, write_static

PARTIAL = ".partial"


def write_run(folder: Path, report_progress: ProgressCount = ignore_progress) -> Steps[Path]:
    """Assembles `run.h5` from the other files; the result of the steps is its path.

    Raises BadInput, naming the file, where a stage is damaged; RigError, DiskFull.
    """
    header = read_header(folder)
    ending = read_ending(folder)
    with new_hdf5_file(folder / RECORDING) as made:
        static = yield from _copy_stages(
            made, iterate_with_progress(stage_files(folder), report_progress), header.source
        )
        _finish(made, folder, replace(header, static=static), ending)
        yield from made.put_in_place()
    return folder / RECORDING


def _copy_stages(
    made: NewHdf5File, files: Iterable[Path], source: Source
) -> Steps[tuple[StaticStage, ...]]:
    """Copies strokes and raw stages into groups of their own with new numbers; the result is the
    static stages, which form one table.
    """
    make_strokes(made.root)
    static: list[StaticStage] = []
    for path in files:
        with open_sealed(path) as (stage, _):
            static += read_static(stage)
            for kind in (STROKES, RAW):
                # By number, not by name: "1000" sorts before "999".
                for number in sorted(stage.get(kind, ()), key=int):
                    part = stage[kind][number]
                    target = _place(made.root, kind)
                    for name, value in part.attrs.items():
                        target.attrs[name] = value
                    yield from copy_streams(part, target, source)
        # After each stage: writes that the disk refused stay in memory, which must not grow.
        made.check()
    return tuple(static)


def _place(root: h5py.Group, kind: str) -> h5py.Group:
    """The next numbered group of its kind."""
    if kind in root:
        parent = root[kind]
    else:
        parent = make_raw_stages(root)
    return parent.create_group(f"{len(parent) + 1:03d}")


def _finish(made: NewHdf5File, folder: Path, known: Recording, ending: Ending | None) -> None:
    strokes = len(made.root[STROKES])
    static = known.static
    if ending is not None and ending.static is not None:
        static = ending.static
    provenance = run_provenance(folder, known, ending, strokes)
    mark_recording(
        made.root,
        replace(known, provenance=provenance),
        has_strokes=bool(strokes or RAW not in made.root),
    )
    write_static(made.root, static)


def create(folder: Path, header: Recording) -> None:
    """Begins a run: makes the folder with `run.json` and the disk reserve, on disk when this
    returns.

    `header` has title, source, nominal model, known_to and provenance. Raises BadInput where there
    is a run already, RigError when the disk refuses.
    """
    if (folder / HEADER).exists() or (folder / RECORDING).exists():
        raise BadInput(
            f"{folder}: holds a run already; recordings are never written over, choose "
            "another place"
        )
    with translate_os_errors(folder, "cannot be made"):
        (folder / STAGES).mkdir(parents=True, exist_ok=True)
    write_header(folder, header)
    # Before anything moves: a disk without this room must refuse the run, not end it.
    DiskReserve(folder).lay()
    # The new folder's own name must survive a power cut, too.
    sync_folder(folder.parent)


def discard(folder: Path) -> None:
    """Removes the folder; for a run that ended before it recorded anything."""
    shutil.rmtree(folder)


def is_run(folder: Path) -> bool:
    return (folder / HEADER).is_file()


def read_stages(folder: Path) -> Recording:
    """Everything that the run recorded so far, from its stage files. The provenance of a run that
    has not ended says so.

    Raises BadInput, naming the file, where one is damaged.
    """
    ending = read_ending(folder)
    recording = merge_stages(
        read_header(folder), (read_recording(file) for file in stage_files(folder))
    )
    return replace(
        recording,
        static=with_photo_angles(recording.static, ending),
        provenance=run_provenance(folder, recording, ending, len(recording.strokes)),
    )


def read_without_samples(folder: Path) -> Recording:
    """The same as `read_stages` without strokes and raw stages, which need memory."""
    ending = read_ending(folder)
    strokes = 0
    static: list[StaticStage] = []
    for path in stage_files(folder):
        with open_sealed(path) as (file, _):
            strokes += len(file[STROKES])
            static += read_static(file)
    recording = replace(read_header(folder), static=tuple(static))
    return replace(
        recording,
        static=with_photo_angles(recording.static, ending),
        provenance=run_provenance(folder, recording, ending, strokes),
    )


def with_photo_angles(
    recorded: tuple[StaticStage, ...], ending: Ending | None
) -> tuple[StaticStage, ...]:
    """The static stages with the angles read from their photos, where the run's end has them."""
    if ending is None or ending.static is None:
        return recorded
    return ending.static


def merge_stages(header: Recording, stages: Iterable[Recording]) -> Recording:
    """The header with the stages in their order."""
    parts = list(stages)
    return replace(
        header,
        strokes=header.strokes + tuple(stroke for part in parts for stroke in part.strokes),
        static=header.static + tuple(stage for part in parts for stage in part.static),
        raw=header.raw + tuple(stage for part in parts for stage in part.raw),
    )


def build_recording(folder: Path, report_progress: ProgressCount = ignore_progress) -> Path:
    """Assembles `run.h5` from the other files, the same bytes every time, and writes the checksums
    of all. Returns its path.

    `report_progress` is called with the number of stages copied so far. The run's end says last
    that all of it was done: a file that is missing after that was removed, and not left unwritten
    by a crash.
    """
    path = run_to_completion(write_run(folder, report_progress))
    ending = read_ending(folder)
    if ending is None:
        write_sums(folder)
        return path
    closed = replace(ending, is_closed=True)
    # Of the end as it will be: whichever of the two a crash prevents, the checksums and the end
    # show which.
    write_sums(folder, {ENDING: ending_bytes(closed)})
    write_ending(folder, closed)
    return path


def close_journals(folder: Path) -> int:
    """Makes stage files of unfinished stages after a crash, and removes the disk reserve and
    half-written files.

    Returns the number of journals. Raises BadInput where the run is still going on.
    """
    check_not_running(folder)
    header = read_header(folder)
    journal_files = journals(folder)
    for journal in journal_files:
        path = journal.with_suffix(STAGE)
        # The crash may have come after the stage file was put in place and before its journal was
        # removed.
        if not path.is_file():
            run_to_completion(write_stage(journal, path, header))
        # Only after its stage file is on disk: a crash in between costs nothing.
        remove(journal)
    for half in folder.rglob(f"*{WRITING}"):
        remove(half)
    DiskReserve(folder).release()
    return len(journal_files)


def reopen(folder: Path, event: Mapping[str, object], resumed: int) -> None:
    """Continues a finished run: adds `event` to its events, on disk, and removes the files that
    only a finished run has.

    `resumed` is how many such events there were when the run was read. Raises BadInput where the
    run is still going on, or where somebody else has resumed it since; RigError when the disk
    refuses.
    """
    events = AppendOnlyFile(folder / EVENTS)
    lock(events)
    try:
        if sum(entry.get("event") == event["event"] for entry in events_of(folder)) != resumed:
            raise BadInput(
                f"{folder}: another process has resumed the run at this moment; wait for its end"
            )
        # First the end says that the run is closed no more, as before its checksums were written:
        # what goes then is no damage.
        if (ending := read_ending(folder)) is not None and ending.is_closed:
            write_ending(folder, replace(ending, is_closed=False))
        # Both were made of the events, and would contradict them. The checksums go first: none may
        # be left of a file that is gone.
        for name in (SUMS, RECORDING):
            remove(folder / name)
        # A crash may have left part of a line, to which the new event would be joined.
        events.cut_to(complete_lines_length((folder / EVENTS).read_bytes()))
        events.append((json.dumps(event, ensure_ascii=False) + "\n").encode())
        # Before the end is removed: after a crash in between, the run still shows how it had ended,
        # or why it was continued.
        events.force()
        remove(folder / ENDING)
        DiskReserve(folder).lay()
    finally:
        events.close()


def partial_of(path: Path) -> Path:
    """The folder with the parts of an unfinished recording; `path` is where the finished file
    would be.
    """
    return path.with_name(path.name + PARTIAL)


def read_partial(path: Path) -> Recording:
    """Everything that was recorded of a run that never finished; its provenance says so."""
    parts = [read_recording(part) for part in sorted(partial_of(path).glob("*.h5"))]
    if not parts:
        raise BadInput(
            f"{partial_of(path)}: holds no recording; the run was interrupted before it began"
        )
    recording = merge_stages(parts[0], parts[1:])
    interruption = (
        f"the run ended without being finished, after {len(recording.strokes)} strokes and "
        f"{len(recording.static)} static stages"
    )
    return replace(recording, provenance={**recording.provenance, INTERRUPTED: interruption})


def recover_partial(path: Path) -> Path:
    """Makes `path` from its partial folder, with every part in it. Returns `path`.

    Where `path` was already complete at the crash, only the leftovers are removed: a recording is
    never overwritten.
    """
    if path.is_file():
        # Reads all of it: the parts are removed only if the file is sound.
        read_recording(path)
    else:
        write_recording(read_partial(path), path)
    for file in partial_of(path).iterdir():
        file.unlink()
    partial_of(path).rmdir()
    return path
